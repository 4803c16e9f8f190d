"""Shares with their intervals as dots: aggregates over games, and ablations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from apil_core.studies.report.figures.palette import INK, Pen, pen_of
from apil_core.studies.report.figures.plot import (
    Plot,
    Spec,
    error_bar,
    in_percent,
    listing,
    percents,
    scale_top,
    spec,
    text,
)
from apil_core.studies.report.models import Ablation, Aggregate
from apil_core.studies.report.words import percent

_METRICS = {"win": "win", "win_or_tie": "win or tie"}


def aggregate_dots(
    aggregates: Sequence[Aggregate], found: dict[str, Pen], settings: dict[str, str]
) -> list[Plot]:
    """Interquartile means: one figure for each setting and metric, a row for each method."""
    groups: dict[tuple[str, str], list[Aggregate]] = {}
    for aggregate in aggregates:
        groups.setdefault((aggregate.setting, aggregate.metric), []).append(aggregate)
    return [_aggregates(group, found, settings.get(setting, "")) for (setting, _), group in groups.items()]


def _aggregates(group: Sequence[Aggregate], found: dict[str, Pen], setting: str) -> Plot:
    traces = []
    for aggregate in group:
        pen = pen_of(found, aggregate.column)
        low, high = (aggregate.iqm if end is None else end for end in (aggregate.low, aggregate.high))
        value, low, high = percents([aggregate.iqm, low, high])
        trace = _dots("", [aggregate.column], [(value, low, high)], pen.colour, pen.symbol)
        traces.append(
            {**trace, "meta": {"method": pen.name}, "hovertemplate": "%{y}: %{x:.1f} %<extra></extra>"}
        )
    figure = _rows(traces, len(group))
    metric = _METRICS[group[0].metric]
    values = [(aggregate.column, f"{percent(aggregate.iqm)} %") for aggregate in group]
    return Plot(
        figure,
        title=f"Interquartile mean over games: {metric}",
        alt=f"Interquartile mean over {len(group[0].games)} games, {metric}: {listing(values)}.",
        caption=setting,
        facets={"measure": group[0].metric, "setting": group[0].setting},
    )


def ablation_dots(ablations: Sequence[Ablation], settings: dict[str, str]) -> list[Plot]:
    """One figure for each ablation: a row for each value, filled dots for win, open ones for win or tie."""
    return [plot for ablation in ablations if (plot := _ablation(ablation, settings)) is not None]


def _ablation(ablation: Ablation, settings: dict[str, str]) -> Plot | None:
    rows = [
        (row.value, win, tie)
        for row in ablation.rows
        if (win := row.cell.win.measured) is not None and (tie := row.cell.win_or_tie.measured) is not None
    ]
    if not rows:
        return None
    names = [value for value, _, _ in rows]
    traces = [
        _dots("win", names, [in_percent(win) for _, win, _ in rows], "var(--line-0)", "circle"),
        _dots("win or tie", names, [in_percent(tie) for _, _, tie in rows], INK, "circle-open"),
    ]
    figure = _rows(
        traces,
        len(rows) + 1,
        showlegend=True,
        legend={"orientation": "h", "x": 0, "y": 1.0, "yanchor": "bottom"},
        margin={"l": 70, "r": 14, "t": 30, "b": 40},
    )
    wins = [(value, f"{percent(win.value)} %") for value, win, _ in rows]
    return Plot(
        figure,
        title=f"{ablation.game}, {ablation.method}: {ablation.title}",
        alt=f"{ablation.title}, {ablation.method} in {ablation.game}, win: {listing(wins)}.",
        caption=settings.get(ablation.setting, ""),
        facets={"game": ablation.game},
    )


def _dots(
    name: str, labels: Sequence[str], ends: Sequence[tuple[float, float, float]], colour: str, symbol: str
) -> dict[str, Any]:
    return {
        "type": "scatter",
        "x": [value for value, _, _ in ends],
        "y": [text(label) for label in labels],
        "error_x": error_bar(ends, colour),
        "name": name,
        "mode": "markers",
        "marker": {"color": colour, "symbol": symbol, "size": 10, "line": {"width": 2, "color": colour}},
        "hovertemplate": "%{y}: %{x:.1f} %",
    }


def _rows(traces: Sequence[dict[str, Any]], count: int, **layout: Any) -> Spec:
    highest = max(
        x + up for trace in traces for x, up in zip(trace["x"], trace["error_x"]["array"], strict=True)
    )
    style: dict[str, Any] = {"margin": {"l": 70, "r": 14, "t": 8, "b": 32}, **layout}
    return spec(
        traces,
        74 + 30 * count,
        x={"range": [0, scale_top(highest)], "ticksuffix": " %"},
        y={"type": "category", "autorange": "reversed"},
        **style,
    )
