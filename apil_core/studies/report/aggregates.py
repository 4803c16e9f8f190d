"""Methods over all games: interquartile means with stratified bootstrap intervals (Agarwal et al. 2021)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Literal

from apil_core.studies.report.statistics import ENOUGH_SEEDS, interquartile_mean, stratified_interval
from apil_core.studies.report.table_models import Aggregate, Cell, Table
from apil_core.studies.report.words import several

Metric = Literal["win", "win_or_tie"]
METRICS: tuple[Metric, ...] = ("win", "win_or_tie")


def aggregates(tables: Sequence[Table]) -> list[Aggregate]:
    """Aggregate every setting's table 1, over the games in which all columns were measured (at least two)."""
    return [found for table in tables if table.number == 1 for found in _of(table)]


def _of(table: Table) -> Iterator[Aggregate]:
    present = {each.column for row in table.rows for each in row if each.scores and not each.replayed}
    rows = [row for row in table.rows if present <= {each.column for each in row if each.scores}]
    if len(rows) < 2:
        return
    for place, column in enumerate(table.columns):
        if column in present:
            for metric in METRICS:
                yield _aggregate(table.setting, column, metric, [row[place] for row in rows])


def _aggregate(setting: str, column: str, metric: Metric, cells: Sequence[Cell]) -> Aggregate:
    figures = (each.win if metric == "win" else each.win_or_tie for each in cells)
    by_game = [figure.measured.per_seed for figure in figures if figure.measured is not None]
    interval = stratified_interval(by_game)
    seeds = min(each.seeds for each in cells)
    trained = any(score.steps is not None for each in cells for score in each.scores)
    return Aggregate(
        setting=setting,
        column=column,
        metric=metric,
        iqm=interquartile_mean([value for values in by_game for value in values]),
        low=None if interval is None else interval[0],
        high=None if interval is None else interval[1],
        games=[each.game for each in cells],
        seeds=seeds,
        note=_note(seeds, trained),
    )


def _note(seeds: int, trained: bool) -> str:
    if not trained:
        return "Not trained here: one agent per game."
    if seeds == 1:
        return "One seed: this says nothing about what other seeds would give."
    if seeds < ENOUGH_SEEDS:
        return f"Only {several(seeds, 'seed')}: the interval is a lower bound of the spread over seeds."
    return ""
