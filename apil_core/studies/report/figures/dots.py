"""Dot plots of shares with their intervals: aggregates over games, and ablations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from apil_core.common.charts import Pen, whisker
from apil_core.studies.report.figures.palette import INK, pen_of, placeholder
from apil_core.studies.report.figures.plot import Plot, listing, scale_top, short
from apil_core.studies.report.models import Ablation
from apil_core.studies.report.table_models import Aggregate
from apil_core.studies.report.words import percent

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_METRICS = {"win": "win", "win_or_tie": "win or tie"}
_WIN, _TIE = Pen(placeholder("line-0"), marker="o"), Pen(INK, marker="D")

Ends = tuple[float, float, float]
"""Value, low and high of a share."""


def aggregate_dots(
    aggregates: Sequence[Aggregate], found: Mapping[str, Pen], settings: Mapping[str, str]
) -> list[Plot]:
    """Make one figure of interquartile means for each setting and metric, a row for each method."""
    groups: dict[tuple[str, str], list[Aggregate]] = {}
    for aggregate in aggregates:
        groups.setdefault((aggregate.setting, aggregate.metric), []).append(aggregate)
    return [_aggregates(group, found, settings.get(setting, "")) for (setting, _), group in groups.items()]


def _aggregates(group: Sequence[Aggregate], found: Mapping[str, Pen], setting: str) -> Plot:
    rows = []
    for each in group:
        low, high = (each.iqm if end is None else end for end in (each.low, each.high))
        rows.append([((each.iqm, low, high), pen_of(found, each.column))])
    metric, columns = _METRICS[group[0].metric], [each.column for each in group]
    values = [(each.column, f"{percent(each.iqm)} %") for each in group]
    return Plot(
        lambda axis: draw_rows(axis, columns, rows),
        title=f"Interquartile mean over games: {metric}",
        alt=f"Interquartile mean over {len(group[0].games)} games, {metric}: {listing(values)}.",
        caption=setting,
        facets={"measure": group[0].metric, "setting": group[0].setting},
        height=0.5 + 0.26 * len(rows),
    )


def ablation_dots(ablations: Sequence[Ablation], settings: Mapping[str, str]) -> list[Plot]:
    """Make one figure for each ablation: a row for each value, circles for win, diamonds for win or tie."""
    return [plot for ablation in ablations if (plot := _ablation(ablation, settings)) is not None]


def _ablation(ablation: Ablation, settings: Mapping[str, str]) -> Plot | None:
    names, rows, wins = [], [], []
    for row in ablation.rows:
        win, tie = row.cell.win.measured, row.cell.win_or_tie.measured
        if win is not None and tie is not None:
            names.append(row.value)
            rows.append(
                [((share.value, share.low, share.high), pen) for share, pen in ((tie, _TIE), (win, _WIN))]
            )
            wins.append((row.value, f"{percent(win.value)} %"))
    if not rows:
        return None
    return Plot(
        lambda axis: draw_rows(axis, names, rows),
        title=f"{ablation.game}, {ablation.method}: {ablation.title}",
        alt=f"{ablation.title}, {ablation.method} in {ablation.game}, win: {listing(wins)}.",
        caption=settings.get(ablation.setting, ""),
        facets={"game": ablation.game},
        height=0.5 + 0.3 * len(rows),
    )


def draw_rows(axis: Axes, names: Sequence[str], rows: Sequence[Sequence[tuple[Ends, Pen]]]) -> None:
    """Draw a row for each name with its shares in per cent, the first on top."""
    for i, row in enumerate(rows):
        for ends, pen in row:
            whisker(axis, i, ends, pen, factor=100.0, level=True, markersize=7)
    highest = max(ends[2] for row in rows for ends, _ in row)
    axis.set(xlim=(0, scale_top(100 * highest)), ylim=(len(rows) - 0.5, -0.5))
    axis.set_yticks(range(len(names)), [short(name) for name in names])
    axis.xaxis.set_major_formatter("{x:g} %")
    axis.grid(axis="y", visible=False)
