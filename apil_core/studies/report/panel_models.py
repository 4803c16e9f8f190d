"""What is drawn, as data: courses, ablations, endings, cross-plays, activations. Shares are fractions."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel

from apil_core.common.statistics import Difference
from apil_core.studies.curves.curves import Line, ScorePoint
from apil_core.studies.report.table_models import Cell, Share, Verdict


class CurveLine(BaseModel):
    """Learning curve of one method in one game and setting.

    Attributes:
        lines: by name as in :mod:`.curves.curves`: ``win``, ``win_or_tie``, ``return``, ``imitator``.
        band: what ``low`` and ``high`` of ``win`` and ``win_or_tie`` are.
        scores: periodic and final evaluations of each seed.
        finished: all its runs are.
    """

    method: str
    label: str
    seeds: list[int]
    lines: dict[str, Line]
    band: Literal["Wilson interval of the last 1000 games", "standard deviation over seeds"]
    scores: list[ScorePoint] = []
    finished: bool = True


class CurvePanel(BaseModel):
    """Curves of one game and training setting; ``baseline_*`` is the baseline adversary's level."""

    game: str
    setting: str
    lines: list[CurveLine]
    baseline_win: float | None = None
    baseline_win_or_tie: float | None = None


class RetrainingLine(BaseModel):
    """The victim's games against one opponent while it was retrained (the victim's view)."""

    opponent: str
    win: Line
    win_or_tie: Line


class RetrainingCurve(BaseModel):
    """One retraining: a victim against a method's adversary and the baseline one."""

    game: str
    method: str
    label: str
    steps: int
    planned_steps: int
    status: str
    lines: list[RetrainingLine]


class AblationRow(BaseModel):
    """One value of an axis; ``*_difference`` is against the first row."""

    value: str
    cell: Cell
    win_difference: Difference | None = None
    win_or_tie_difference: Difference | None = None
    win_verdict: Verdict | None = None
    win_or_tie_verdict: Verdict | None = None
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


class Endings(BaseModel):
    """How the games of one cell ended, all seeds together.

    Attributes:
        table: its id.
        causes: counts by name, most frequent first.
    """

    table: str
    setting: str
    game: str
    column: str
    episodes: int
    wins: int
    ties: int
    losses: int
    causes: dict[str, int]
    mean_length: float


class CrossPlayMatrix(BaseModel):
    """Every adversary against every victim of a game; shares are the adversary's.

    Attributes:
        win, win_or_tie: (adversaries, victims); ``None`` where nothing has been played yet.
        setting: in words: games, physics, action modes.
    """

    game: str
    setting: str
    adversaries: list[str]
    victims: list[str]
    episodes: int
    win: list[list[Share | None]]
    win_or_tie: list[list[Share | None]]


class ActivationCloud(BaseModel):
    """The victim's activations against one opponent; likelihoods in nats per activation vector.

    Attributes:
        points: (x, y) of the t-SNE.
        log_likelihood, low, high: mean and 95 % interval under the density of normal play.
        games: behind the likelihood.
    """

    opponent: str
    points: list[tuple[float, float]]
    log_likelihood: float | None = None
    low: float | None = None
    high: float | None = None
    games: int | None = None


class Activations(BaseModel):
    """t-SNE and density of one victim's activations."""

    game: str
    victim: str
    layer: str
    clouds: list[ActivationCloud]
    notes: list[str] = []


class Snapshot(BaseModel):
    """A strip of pictures of one game: a ``data:`` URI, so that the page needs no file."""

    game: str
    method: str
    path: str
    data_uri: str
    caption: str = ""


class Diagnostics(BaseModel):
    """Numbers that show how a training went, beside its score.

    Attributes:
        facts: final values by name, e.g. ``imitator mse / constant mse``.
        lines: over steps by name, e.g. ``kl`` between successive adversaries, ``bound``.
        notes: what they mean, one sentence each.
    """

    game: str
    method: str
    seed: int
    setting: str
    run: str
    facts: dict[str, float] = {}
    lines: dict[str, Line] = {}
    notes: list[str] = []
