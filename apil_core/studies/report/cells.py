"""Tables and their cells: scores of several seeds with the published value."""

from __future__ import annotations

from collections.abc import Sequence

from apil_core.evaluation.results import EvaluationResult
from apil_core.studies.report.grouping import Scored
from apil_core.studies.report.published import published
from apil_core.studies.report.statistics import compared, published_rate, share, verdict
from apil_core.studies.report.table_models import (
    METRICS,
    Cell,
    Figure,
    MethodDifference,
    SeedScore,
    Side,
    Table,
)


def seed_scores(members: Sequence[Scored]) -> list[SeedScore]:
    """Scores of trained adversaries, from the adversary's side."""
    return [seed_score(each.score, each.run.path, each.run.config.seed) for each in members]


def seed_score(
    score: EvaluationResult, source: str, seed: int | None = None, side: Side = "adversary"
) -> SeedScore:
    """One score, from the given side."""
    wins, losses = (score.wins, score.losses) if side == "adversary" else (score.losses, score.wins)
    return SeedScore(
        seed=seed,
        source=source,
        steps=score.trained_steps,
        episodes=score.episodes,
        wins=wins,
        ties=score.ties,
        losses=losses,
        causes=dict(sorted(score.causes.items(), key=lambda item: -item[1])),
        mean_length=score.mean_length,
        white_box=score.white_box,
    )


def cell(
    game: str,
    column: str,
    scores: Sequence[SeedScore],
    value: tuple[float, float] | None,
    marks: Sequence[str] = (),
) -> Cell:
    """Make a cell with win and win+tie.

    Args:
        game, column: its position.
        scores: one per seed, or none.
        value: published win and win+tie, as fractions.
        marks: warning labels.
    """
    wins = [score.wins for score in scores]
    either = [score.wins + score.ties for score in scores]
    games = [score.episodes for score in scores]
    return Cell(
        game=game,
        column=column,
        win=_figure(wins, games, None if value is None else value[0]),
        win_or_tie=_figure(either, games, None if value is None else value[1]),
        scores=list(scores),
        marks=[*marks, *(["white box"] if any(score.white_box for score in scores) else [])],
    )


def _figure(counts: Sequence[int], games: Sequence[int], value: float | None) -> Figure:
    if not counts:
        return Figure(published=value)
    measured = share(counts, games)
    if value is None:
        return Figure(measured=measured, verdict="no published value")
    difference = compared(measured, published_rate(value, published().episodes))
    return Figure(measured=measured, published=value, difference=difference, verdict=verdict(difference))


def method_difference(own: Cell, base: Cell, **named: str) -> MethodDifference:
    """Compare two measured cells of a game; ``named``: other fields, such as the table."""
    pairs = {metric: (own.share(metric), base.share(metric)) for metric in METRICS}
    found = {metric: compared(a, b) for metric, (a, b) in pairs.items() if a is not None and b is not None}
    verdicts = {f"{metric}_verdict": verdict(difference) for metric, difference in found.items()}
    columns = {"game": own.game, "column": own.column, "base": base.column}
    return MethodDifference.model_validate({**columns, **found, **verdicts, **named})


TITLES = {
    1: "Adversaries against the victim",
    2: "Blinded adversaries against the victim",
    3: "Retrained victims against the baseline adversary",
    4: "Retrained victims against E-APIL's adversary",
}


def make_table(
    number: int, setting: str, columns: Sequence[str], rows: list[list[Cell]], blind: str | None = None
) -> Table:
    """Make one of the paper's tables, 1 to 4, in one setting; see :class:`.table_models.Table`."""
    suffix = "" if blind is None else f"-{blind.replace(', ', '-').replace(' ', '-')}"
    named = {"id": f"t{number}-{setting}{suffix}", "number": number, "title": TITLES[number], "blind": blind}
    shown = {"side": published().tables[number].side, "setting": setting, "columns": columns, "rows": rows}
    return Table.model_validate({**named, **shown})
