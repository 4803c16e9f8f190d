"""Aggregates over games and ablations: shares with their intervals, and performance profiles."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TypeVar

from apil_core.common.charts import Pen, whisker
from apil_core.studies.report.figures.palette import INK, NEUTRAL, pen_of, placeholder
from apil_core.studies.report.figures.plot import Plot, listing, scale_top, short
from apil_core.studies.report.models import Ablation
from apil_core.studies.report.statistics import THRESHOLDS
from apil_core.studies.report.table_models import Aggregate, Improvement, Profile
from apil_core.studies.report.words import MEASURES, percent, several

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Of = TypeVar("Of", Aggregate, Profile, Improvement)

_WIN, _TIE = Pen(placeholder("line-0"), marker="o"), Pen(INK, marker="D")

Ends = tuple[float, float, float]
"""Value, low and high of a share."""


def means(group: Sequence[Aggregate], found: Mapping[str, Pen], settings: Mapping[str, str]) -> Plot:
    """Draw interquartile means of one setting and metric, a row for each method."""
    ends = [(e.iqm, e.iqm if e.low is None else e.low, e.iqm if e.high is None else e.high) for e in group]
    rows = [[(each, pen_of(found, of.column))] for each, of in zip(ends, group, strict=True)]
    values = [(each.column, each.iqm) for each in group]
    title = f"Interquartile mean over {several(len(group[0].games), 'game')}"
    draw = partial(draw_rows, names=[short(each.column) for each in group], rows=rows)
    return _plot(draw, group[0], title, values, settings, height=0.5 + 0.26 * len(group))


def performance(group: Sequence[Profile], found: Mapping[str, Pen], settings: Mapping[str, str]) -> Plot:
    """Draw performance profiles of one setting and metric."""

    def draw(axis: Axes) -> None:
        scores = [100 * threshold for threshold in THRESHOLDS]
        for each in group:
            pen = pen_of(found, each.column)
            value, low, high = ([100 * v for v in values] for values in (each.value, each.low, each.high))
            line: Any = {"color": pen.colour, "linestyle": pen.dashes, "linewidth": 1.8, "zorder": 3}
            axis.step(scores, value, where="post", **line)
            axis.fill_between(scores, low, high, step="post", color=pen.colour, alpha=0.15, linewidth=0)
        axis.set(xlim=(0, 100), ylim=(0, 102), ylabel="runs with a higher score, %")
        axis.set_xlabel(f"{MEASURES[group[0].metric]}, % of games")

    values, runs = [(e.column, e.value[50]) for e in group], {e.column: e.runs for e in group}
    return _plot(draw, group[0], "Performance profile", values, settings, runs, "runs above 50 %, ")


def improved(group: Sequence[Improvement], found: Mapping[str, Pen], settings: Mapping[str, str]) -> Plot:
    """Draw probabilities of improvement of one setting and metric, a row for each pair."""

    def draw(axis: Axes) -> None:
        rows = [[((each.value, each.low, each.high), pen_of(found, each.column))] for each in group]
        draw_rows(axis, [f"{short(each.column)} over {short(each.base)}" for each in group], rows)
        axis.set_xlim(-2, 102)
        axis.axvline(50, color=NEUTRAL, linestyle="--", linewidth=1.2, zorder=1)

    values = [(f"{each.column} over {each.base}", each.value) for each in group]
    runs = {each.base: each.base_runs for each in group} | {each.column: each.runs for each in group}
    height = 0.5 + 0.26 * len(group)
    return _plot(draw, group[0], "Probability of improvement", values, settings, runs, height=height)


def _plot(
    draw: Callable[[Axes], None],
    first: Aggregate | Profile | Improvement,
    title: str,
    values: Sequence[tuple[str, float]],
    settings: Mapping[str, str],
    runs: Mapping[str, int] = MappingProxyType({}),
    what: str = "",
    height: float = 2.7,
) -> Plot:
    """A figure of one setting and metric; ``values`` are those of its alternative text."""
    metric, setting = MEASURES[first.metric], settings.get(first.setting, "")
    behind = f"Runs: {', '.join(f'{name} {count}' for name, count in runs.items())}." if runs else ""
    shares = listing([(name, f"{percent(value)} %") for name, value in values])
    return Plot(
        draw,
        title=f"{title}: {metric}",
        alt=f"{title}, {metric}: {what}{shares}.",
        caption=". ".join(filter(None, (setting, behind))),
        facets={"measure": first.metric, "setting": first.setting},
        height=height,
    )


def by_metric(items: Sequence[Of]) -> list[list[Of]]:
    """Group by setting and metric."""
    groups: dict[tuple[str, str], list[Of]] = {}
    for each in items:
        groups.setdefault((each.setting, each.metric), []).append(each)
    return list(groups.values())


def ablated(ablation: Ablation, settings: Mapping[str, str]) -> Plot:
    """Draw an ablation: a row for each value that was measured, circles for win, diamonds for win or tie."""
    pairs = [(row.value, row.cell.win.measured, row.cell.win_or_tie.measured) for row in ablation.rows]
    measured = [(name, win, tie) for name, win, tie in pairs if win is not None and tie is not None]
    rows = [
        [((share.value, share.low, share.high), pen) for share, pen in ((tie, _TIE), (win, _WIN))]
        for _, win, tie in measured
    ]
    wins = listing([(name, f"{percent(win.value)} %") for name, win, _ in measured])
    return Plot(
        lambda axis: draw_rows(axis, [short(name) for name, _, _ in measured], rows),
        title=f"{ablation.game}, {ablation.method}: {ablation.title}",
        alt=f"{ablation.title}, {ablation.method} in {ablation.game}, win: {wins}.",
        caption=settings.get(ablation.setting, ""),
        facets={"game": ablation.game},
        height=0.5 + 0.3 * len(rows),
    )


def draw_rows(axis: Axes, names: Sequence[str], rows: Sequence[Sequence[tuple[Ends, Pen]]]) -> None:
    """Draw a row for each (short) name with its shares in per cent, the first on top."""
    for i, row in enumerate(rows):
        for ends, pen in row:
            whisker(axis, i, ends, pen, factor=100.0, level=True, markersize=7)
    highest = max(ends[2] for row in rows for ends, _ in row)
    axis.set(xlim=(0, scale_top(100 * highest)), ylim=(len(rows) - 0.5, -0.5))
    axis.set_yticks(range(len(names)), names)
    axis.xaxis.set_major_formatter("{x:g} %")
    axis.grid(axis="y", visible=False)
