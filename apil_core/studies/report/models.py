"""Data of a report other than its tables. Shares of games are fractions, published ones too."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel

from apil_core.common.documents import EXACT
from apil_core.evaluation.crossplay.document import CrossPlay
from apil_core.studies.activations.models import ActivationMap
from apil_core.studies.curves.curves import Line
from apil_core.studies.curves.groups import CurveGroup
from apil_core.studies.report.table_models import (
    Aggregate,
    Cell,
    Improvement,
    MethodDifference,
    Profile,
    Setting,
    Table,
)

Truth = Literal["holds", "does not hold", "cannot be told"]
"""Verdict on a claim."""


class Warning(BaseModel):
    """A caveat that a reader needs for interpreting a number.

    Attributes:
        kind: ``ties``, ``seeds``, ``episodes``, ``budget``, ``physics``, ``victim``, ``action modes``,
            ``settings``, ``imitator``, ``no attack``, ``unfinished``, ``damaged``, ``delta r``, ``copies``,
            ``stale``, ``baseline``, ``left out``.
        loud: concerns every number of a setting; else single cells.
        text: one whole sentence with the numbers.
        setting, game, column: its scope; ``None``: all of them.
    """

    kind: str
    loud: bool
    text: str
    setting: str | None = None
    game: str | None = None
    column: str | None = None


class Check(BaseModel):
    """A claim in one game: the verdict, and a sentence with the numbers."""

    game: str
    verdict: Truth
    text: str


class Claim(BaseModel):
    """A statement of the paper, checked on these games.

    Attributes:
        id: ``beats baseline``, ``order``, ``blinding``, ``resists``, ``remembers``, ….
        claim: the statement.
        published: the check on the paper's own numbers.
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


class CurvePanel(BaseModel):
    """Learning curves of one game and training setting; ``baseline_*`` is the baseline adversary's level."""

    game: str
    setting: str
    groups: list[CurveGroup]
    baseline_win: float | None = None
    baseline_win_or_tie: float | None = None


class RetrainingCurve(BaseModel):
    """One retraining: a victim's games against each opponent, a method's adversary and the baseline one."""

    game: str
    method: str
    label: str
    steps: int
    planned_steps: int
    status: str
    groups: list[CurveGroup]


class AblationRow(BaseModel):
    """One value of an axis; its difference is to the first row."""

    value: str
    cell: Cell
    difference: MethodDifference | None = None
    imitator_error: float | None = None
    """Imitator's squared error over the best constant's, in the end, mean over seeds; below 1 it learnt."""


class Ablation(BaseModel):
    """Cells that differ in one axis only, e.g. ``options.apil.prediction``; the first row is the default."""

    axis: str
    title: str
    game: str
    method: str
    setting: str
    rows: list[AblationRow]


class Snapshot(BaseModel):
    """A strip of pictures of one game: a ``data:`` URI, so that the page needs no file."""

    game: str
    method: str
    path: str
    data_uri: str
    caption: str = ""


class Diagnostics(BaseModel):
    """Metrics that show how a training went, apart from its score.

    Attributes:
        facts: final values by name, e.g. ``imitator mse / constant mse``.
        lines: over steps by name, e.g. ``kl`` between successive adversaries, ``bound``.
        notes: explanations, one sentence each.
    """

    game: str
    method: str
    seed: int
    setting: str
    run: str
    facts: dict[str, float] = {}
    lines: dict[str, Line] = {}
    notes: list[str] = []


class Unfinished(BaseModel):
    """A cell without its score, with the reason."""

    game: str
    method: str
    label: str
    status: str
    steps: int = 0
    planned_steps: int | None = None
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
    """Sources of the numbers.

    Attributes:
        matrices: resolved matrix of each directory, by its path.
        versions, git, hosts: all that occur among the runs.
        hours, steps: of training, summed over runs.
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


class ReportData(BaseModel):
    """All data that the report shows.

    Attributes:
        games, columns: in the order of every table; ``columns`` starts with ``baseline``.
        settings: main one first (the shipped story); all others refer to them by ``id``.
    """

    version: Literal[2] = 2
    title: str
    games: list[str]
    columns: list[str]
    settings: list[Setting]
    tables: list[Table]
    differences: list[MethodDifference]
    aggregates: list[Aggregate]
    profiles: list[Profile]
    improvements: list[Improvement]
    curves: list[CurvePanel]
    retraining: list[RetrainingCurve]
    ablations: list[Ablation]
    crossplay: list[CrossPlay]
    activations: list[ActivationMap]
    snapshots: list[Snapshot]
    diagnostics: list[Diagnostics]
    claims: list[Claim]
    warnings: list[Warning]
    unfinished: list[Unfinished]
    provenance: Provenance

    def setting(self, key: str) -> Setting:
        """Return the setting with that id."""
        return next(setting for setting in self.settings if setting.id == key)
