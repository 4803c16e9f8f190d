"""Data of tables: settings, cells with their figures, method comparisons. Shares of games are fractions."""

from __future__ import annotations

from collections import Counter
from typing import Any, Literal

from pydantic import BaseModel

from apil_core.common.documents import EXACT
from apil_core.common.statistics import Difference
from apil_core.studies.report.words import budget_mark

Verdict = Literal["within noise", "higher", "lower", "no published value", "not measured"]
"""Sign of the difference of two shares; ``within noise`` means that it could be chance."""

Metric = Literal["win", "win_or_tie"]
"""Share of games: those won, or those won or tied."""

METRICS: tuple[Metric, ...] = ("win", "win_or_tie")

Side = Literal["adversary", "victim"]
"""Side whose wins a share counts."""


class Setting(BaseModel):
    """Settings shared by cells that may be compared or averaged: one block of each table.

    Attributes:
        id: short and stable: ``"s1"``, …
        label: in words, e.g. ``"1 M steps, fast physics"``; unique in the report.
        steps: adversaries' requested training budget; ``None`` where there is none or several.
        retrain_steps: budget of the victims' retraining, in tables 3 and 4.
        published_steps: the published budget that this one is measured by; ``None`` where the paper played
            none of its games.
        budget_share: of the published budget, as a fraction (of the retraining's where there is one).
        trained_physics, physics: profiles of training and of the scored games; ``None`` without profiles.
        victim: ``"default"`` (each game's own, the papers' where it is one of theirs),
            ``"embedded student"`` or a policy's name.
        adversary_actions, victim_actions: how actions of the scored games were chosen.
        axes: further settings that tell it from others, by their names in ``--set``.
        changes_method: an option of a method makes it another one than the published one.
        notes: reasons why its numbers are weaker than the published ones, one sentence each, main ones first.
        matches_published: nothing of that kind: budget, physics, victim and action modes are the paper's.
    """

    model_config = EXACT

    id: str
    label: str
    steps: int | None = None
    retrain_steps: int | None = None
    published_steps: int | None = None
    budget_share: float | None = None
    trained_physics: str | None = None
    physics: str | None = None
    victim: str = "default"
    adversary_actions: str = ""
    victim_actions: str = ""
    axes: dict[str, Any] = {}
    changes_method: bool = False
    notes: list[str] = []
    matches_published: bool = False

    @property
    def budget(self) -> str:
        """The budget's warning: ``"1 M of 35 M = 2.9 %"``; empty if the budget is the published one."""
        own = self.retrain_steps if self.retrain_steps is not None else self.steps
        return budget_mark(own, self.published_steps)


class Share(BaseModel):
    """A share of games, over one seed or several.

    Attributes:
        value: mean over seeds.
        low, high: 95 % interval.
        interval: what the interval covers: ``"games"`` (Wilson, over the games of these agents: below
            three seeds) or ``"seeds"`` (Student's t over seeds, never narrower than the former).
        sd: standard deviation over seeds; ``None`` below two.
        minimum, maximum: over seeds.
        per_seed: value of each seed, as in the cell's ``scores``.
    """

    value: float
    low: float
    high: float
    interval: Literal["games", "seeds"]
    sd: float | None
    minimum: float
    maximum: float
    per_seed: list[float]


class Figure(BaseModel):
    """A measured share with its published value.

    Attributes:
        difference: measured minus published, with Newcombe's interval.
    """

    measured: Share | None = None
    published: float | None = None
    difference: Difference | None = None
    verdict: Verdict = "not measured"


class SeedScore(BaseModel):
    """The games of one trained agent; counts are from the table's side.

    Attributes:
        source: the run directory, the two labels of a cross-play, or a policy's name and hash.
        steps: it was trained for; ``None`` for agents that were not trained here.
        white_box: the adversary's method saw inside the victim.
    """

    seed: int | None
    source: str
    steps: int | None
    episodes: int
    wins: int
    ties: int
    losses: int
    causes: dict[str, int]
    mean_length: float
    white_box: bool = False


class Cell(BaseModel):
    """One game × column of a table.

    Attributes:
        column: ``"baseline"``, a method's name, or the label of an adversary that was not trained here.
        scores: one per seed; empty if nothing was measured.
        marks: short warning labels, e.g. ``"1 M of 35 M = 2.9 %"``, ``"1 seed"``.
        replayed: of the latter, what it is: ``"published weights, replayed here"``; else empty.
    """

    game: str
    column: str
    win: Figure
    win_or_tie: Figure
    scores: list[SeedScore] = []
    marks: list[str] = []
    replayed: str = ""

    def share(self, metric: Metric) -> Share | None:
        """The measured share."""
        return (self.win if metric == "win" else self.win_or_tie).measured

    @property
    def episodes(self) -> int:
        """Games of all seeds."""
        return self.total("episodes")

    def total(self, count: str) -> int:
        """Sum over seeds of a count: ``"wins"``, ``"ties"``, ``"losses"`` or ``"episodes"``."""
        return sum(getattr(score, count) for score in self.scores)

    @property
    def causes(self) -> dict[str, int]:
        """How often games of all seeds ended how, most frequent first."""
        counts = sum((Counter(score.causes) for score in self.scores), Counter[str]())
        return dict(counts.most_common())

    @property
    def seeds(self) -> int:
        """Number of seeds."""
        return len(self.scores)


class Table(BaseModel):
    """One of the paper's four tables in one setting.

    Attributes:
        id: ``"t1-s1"``, ``"t2-s1-zeros"``, …; unique in a report.
        number: 1 to 4, the paper's.
        side: the one whose wins are counted.
        columns: baseline first, then the paper's methods, then others, then adversaries not trained here.
        blind: table 2: how the adversary was blinded, e.g. ``"zeros"`` or ``"zeros, imitator too"``.
        rows: one list per game, cells in the order of ``columns``.
    """

    id: str
    number: Literal[1, 2, 3, 4]
    title: str
    side: Side
    setting: str
    columns: list[str]
    blind: str | None = None
    rows: list[list[Cell]]

    @property
    def cells(self) -> list[Cell]:
        """Those with a score."""
        return [cell for row in self.rows for cell in row if cell.scores]


class MethodDifference(BaseModel):
    """Difference of two columns of one game in one table, or of two values of an ablation: minus ``base``."""

    table: str = ""
    setting: str
    game: str
    column: str
    base: str
    win: Difference
    win_or_tie: Difference
    win_verdict: Verdict
    win_or_tie_verdict: Verdict


class OverGames(BaseModel):
    """Something of a method over all games of a setting."""

    setting: str
    column: str
    metric: Metric


class Aggregate(OverGames):
    """Interquartile mean over games and seeds.

    Attributes:
        low, high: 95 % stratified bootstrap interval (seeds redrawn within each game); ``None`` with fewer
            than two seeds in a game.
        games, seeds: behind it; ``seeds`` is the least of any game.
        note: its limitation.
    """

    iqm: float
    low: float | None
    high: float | None
    games: list[str]
    seeds: int
    note: str


class Profile(OverGames):
    """Performance profile.

    Attributes:
        runs: behind it, at least two in each game.
        value: share of runs with a score above 0, 1, … 100 %, mean over games.
        low, high: pointwise 95 % stratified bootstrap interval.
    """

    runs: int
    value: list[float]
    low: list[float]
    high: list[float]


class Improvement(OverGames):
    """Probability that a run of ``column`` scores higher than one of ``base`` in the same game.

    Attributes:
        runs, base_runs: behind it, at least two in each game; one in each of a fixed agent.
        value: mean over games; equal scores count half.
        low, high: 95 % stratified bootstrap interval.
    """

    base: str
    runs: int
    base_runs: int
    value: float
    low: float
    high: float
