"""Everything a report shows, as data. Shares of games are fractions, published ones too."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel

from apil_core.common.documents import EXACT
from apil_core.studies.report.panel_models import (
    Ablation,
    AblationRow,
    ActivationCloud,
    Activations,
    CrossPlayMatrix,
    CurveLine,
    CurvePanel,
    Diagnostics,
    Endings,
    RetrainingCurve,
    RetrainingLine,
    Snapshot,
)
from apil_core.studies.report.table_models import (
    Aggregate,
    Cell,
    Figure,
    MethodDifference,
    SeedScore,
    Setting,
    Share,
    Side,
    Table,
    Verdict,
)

__all__ = [
    "Ablation",
    "AblationRow",
    "ActivationCloud",
    "Activations",
    "Aggregate",
    "Cell",
    "Check",
    "Claim",
    "CrossPlayMatrix",
    "CurveLine",
    "CurvePanel",
    "Diagnostics",
    "Endings",
    "Evidence",
    "Figure",
    "MethodDifference",
    "Provenance",
    "RetrainingCurve",
    "RetrainingLine",
    "RunFacts",
    "SeedScore",
    "Setting",
    "Share",
    "Side",
    "Snapshot",
    "Table",
    "Truth",
    "Unfinished",
    "Verdict",
    "Warning",
]

Truth = Literal["holds", "does not hold", "cannot be told"]
"""What these games say about a claim."""


class Warning(BaseModel):
    """Something a reader must know before believing a number.

    Attributes:
        kind: ``ties``, ``tie meaning``, ``seeds``, ``episodes``, ``budget``, ``physics``, ``victim``,
            ``action modes``, ``imitator``, ``no attack``, ``unfinished``, ``delta r``, ``copies``, ``stale``.
        loud: concerns every number of a setting; else single cells.
        text: one whole sentence with the numbers.
        setting, game, column: what it is about; ``None``: all of them.
    """

    kind: str
    loud: bool
    text: str
    setting: str | None = None
    game: str | None = None
    column: str | None = None


class Check(BaseModel):
    """A claim in one game: the verdict and the sentence with the numbers behind it."""

    game: str
    verdict: Truth
    text: str


class Claim(BaseModel):
    """A statement of the paper, checked on these games.

    Attributes:
        id: ``beats baseline``, ``order``, ``blinding``, ``resists``, ``remembers``, ….
        claim: the statement.
        published: what the paper's own numbers say about it.
        setting: the block of tables it was checked in.
        verdict, text: over all games.
        checks: per game.
    """

    id: str
    claim: str
    published: str
    setting: str
    verdict: Truth
    text: str
    checks: list[Check] = []


class Unfinished(BaseModel):
    """A cell without its score: why."""

    game: str
    method: str
    label: str
    status: str
    steps: int
    planned_steps: int | None
    reason: str
    path: str


class RunFacts(BaseModel):
    """One run behind the report."""

    game: str
    method: str
    seed: int
    label: str
    path: str
    status: str
    steps: int
    planned_steps: int
    hours: float
    steps_per_second: float
    physics: str | None
    victim: str
    victim_sha256: str
    host: str
    git: str
    versions: dict[str, str]


class Provenance(BaseModel):
    """Where the numbers come from.

    Attributes:
        matrices: resolved matrix of each directory, by its path.
        versions, git, hosts: all that occur among the runs.
        hours: of training, summed over runs.
        steps: of training, summed over runs.
    """

    model_config = EXACT

    directories: list[str]
    matrices: dict[str, dict[str, Any]]
    runs: list[RunFacts]
    versions: dict[str, list[str]]
    git: list[str]
    hosts: list[str]
    hours: float
    steps: int
    written: str
    apil: str


class Evidence(BaseModel):
    """Everything the report shows.

    Attributes:
        games, columns: in the order of every table; ``columns`` starts with ``baseline``.
        settings: main one first (the shipped story); all others refer to them by ``id``.
    """

    version: Literal[1] = 1
    title: str
    games: list[str]
    columns: list[str]
    settings: list[Setting]
    tables: list[Table]
    differences: list[MethodDifference]
    aggregates: list[Aggregate]
    curves: list[CurvePanel]
    retraining: list[RetrainingCurve]
    ablations: list[Ablation]
    endings: list[Endings]
    crossplay: list[CrossPlayMatrix]
    activations: list[Activations]
    snapshots: list[Snapshot]
    diagnostics: list[Diagnostics]
    claims: list[Claim]
    warnings: list[Warning]
    unfinished: list[Unfinished]
    provenance: Provenance

    def setting(self, key: str) -> Setting:
        """The setting with that id."""
        return next(setting for setting in self.settings if setting.id == key)
