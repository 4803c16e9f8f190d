"""Methods over games and seeds (Agarwal et al. 2021): interquartile means, profiles, improvements."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from apil_core.studies.report.statistics import (
    ENOUGH_SEEDS,
    bootstrapped,
    interquartile_mean,
    performance_profile,
    probability_of_improvement,
)
from apil_core.studies.report.table_models import (
    METRICS,
    Aggregate,
    Cell,
    Improvement,
    Metric,
    Profile,
    Table,
)
from apil_core.studies.report.words import several

Columns = Mapping[str, Sequence[Cell]]
"""Cells of each column, one per game."""


def aggregates(tables: Sequence[Table]) -> list[Aggregate]:
    """Interquartile mean of every column of every setting."""
    return [
        Aggregate(
            setting=setting,
            column=column,
            metric=metric,
            iqm=value,
            low=low,
            high=high,
            games=[each.game for each in cells],
            seeds=min(each.seeds for each in cells),
            note=_note(cells),
        )
        for setting, metric, columns in _over_games(tables)
        for column, cells in columns.items()
        for value, low, high in [bootstrapped(interquartile_mean, _scores(cells, metric))]
    ]


def profiles(tables: Sequence[Table]) -> list[Profile]:
    """Performance profile of every column with at least two runs in each game."""
    return [
        Profile(
            setting=setting, column=column, metric=metric, runs=_runs(cells), value=value, low=low, high=high
        )
        for setting, metric, columns in _over_games(tables)
        for column, cells in columns.items()
        if _several(cells)
        for value, low, high in [bootstrapped(performance_profile, _scores(cells, metric))]
    ]


def improvements(tables: Sequence[Table]) -> list[Improvement]:
    """Probability of improvement of such a column over every one before it; one fixed agent is one run."""
    found = []
    for setting, metric, columns in _over_games(tables):
        names = [name for name, cells in columns.items() if _several(cells) or not _trained(cells)]
        for place, column in enumerate(names):
            for base in names[:place] if _several(columns[column]) else ():
                own, other = columns[column], columns[base]
                scores = [
                    *_scores(own, metric),
                    *(one if len(one) > 1 else one * 2 for one in _scores(other, metric)),
                ]
                value, low, high = bootstrapped(probability_of_improvement, scores)
                runs = {"runs": _runs(own), "base_runs": _runs(other)}
                ends = {"value": value, "low": low, "high": high}
                found.append(
                    Improvement(setting=setting, column=column, base=base, metric=metric, **runs, **ends)
                )
    return found


def _over_games(tables: Sequence[Table]) -> Iterator[tuple[str, Metric, Columns]]:
    """Every setting's table 1, over the games in which all columns were measured: two, or two runs of one."""
    for table in tables:
        present = {each.column for each in table.cells if not each.replayed}
        rows = [row for row in table.rows if present <= {each.column for each in row if each.scores}]
        if table.number == 1 and (len(rows) > 1 or any(each.seeds > 1 for row in rows for each in row)):
            columns = {
                column: [row[place] for row in rows]
                for place, column in enumerate(table.columns)
                if column in present
            }
            yield from ((table.setting, metric, columns) for metric in METRICS)


def _scores(cells: Sequence[Cell], metric: Metric) -> list[list[float]]:
    return [share.per_seed for each in cells if (share := each.share(metric)) is not None]


def _several(cells: Sequence[Cell]) -> bool:
    return min(each.seeds for each in cells) > 1


def _trained(cells: Sequence[Cell]) -> bool:
    return any(score.steps is not None for each in cells for score in each.scores)


def _runs(cells: Sequence[Cell]) -> int:
    return sum(each.seeds for each in cells)


def _note(cells: Sequence[Cell]) -> str:
    seeds = min(each.seeds for each in cells)
    if not _trained(cells):
        return "Not trained here: one agent per game."
    if seeds == 1:
        return "One seed: this says nothing about what other seeds would give."
    if seeds < ENOUGH_SEEDS:
        return f"Only {several(seeds, 'seed')}: the interval is a lower bound of the spread over seeds."
    return ""
