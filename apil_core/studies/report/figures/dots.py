"""Aggregates over games and ablations: shares with their intervals, and performance profiles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, TypeVar

from apil_core.common.charts import Pen, whisker
from apil_core.studies.report.figures.palette import INK, NEUTRAL, pen_of, placeholder
from apil_core.studies.report.figures.plot import Plot, listing, scale_top, short
from apil_core.studies.report.models import Ablation
from apil_core.studies.report.statistics import THRESHOLDS
from apil_core.studies.report.table_models import Aggregate, Improvement, Profile
from apil_core.studies.report.words import percent, several

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Of = TypeVar("Of", Aggregate, Profile, Improvement)

_METRICS = {"win": "win", "win_or_tie": "win or tie"}
_WIN, _TIE = Pen(placeholder("line-0"), marker="o"), Pen(INK, marker="D")

Ends = tuple[float, float, float]
"""Value, low and high of a share."""


def aggregate_dots(
    aggregates: Sequence[Aggregate], found: Mapping[str, Pen], settings: Mapping[str, str]
) -> list[Plot]:
    """Make one figure of interquartile means for each setting and metric, a row for each method."""
    return [
        _aggregates(g, found, settings.get(setting, "")) for (setting, _), g in _grouped(aggregates).items()
    ]


def _aggregates(group: Sequence[Aggregate], found: Mapping[str, Pen], setting: str) -> Plot:
    rows = []
    for each in group:
        low, high = (each.iqm if end is None else end for end in (each.low, each.high))
        rows.append([((each.iqm, low, high), pen_of(found, each.column))])
    metric, columns = _METRICS[group[0].metric], [each.column for each in group]
    values = [(each.column, f"{percent(each.iqm)} %") for each in group]
    return Plot(
        lambda axis: draw_rows(axis, columns, rows),
        title=f"Interquartile mean: {metric}",
        alt=f"Interquartile mean over {several(len(group[0].games), 'game')}, {metric}: {listing(values)}.",
        caption=setting,
        facets={"measure": group[0].metric, "setting": group[0].setting},
        height=0.5 + 0.26 * len(rows),
    )


def profile_plots(
    profiles: Sequence[Profile], found: Mapping[str, Pen], settings: Mapping[str, str]
) -> list[Plot]:
    """Make one figure of performance profiles for each setting and metric."""
    plots = []
    for (setting, metric), group in _grouped(profiles).items():
        values = [(each.column, f"{percent(each.value[50])} %") for each in group]
        plots.append(
            Plot(
                partial(_draw_profiles, group=group, found=found),
                title=f"Performance profile: {_METRICS[metric]}",
                alt=f"Share of runs above a {_METRICS[metric]} rate of 50 %: {listing(values)}.",
                caption=_caption(settings.get(setting, ""), {each.column: each.runs for each in group}),
                facets={"measure": metric, "setting": setting},
            )
        )
    return plots


def _draw_profiles(axis: Axes, group: Sequence[Profile], found: Mapping[str, Pen]) -> None:
    scores = [100 * threshold for threshold in THRESHOLDS]
    for each in group:
        pen = pen_of(found, each.column)
        value, low, high = ([100 * v for v in values] for values in (each.value, each.low, each.high))
        axis.step(
            scores, value, where="post", color=pen.colour, linestyle=pen.dashes, linewidth=1.8, zorder=3
        )
        axis.fill_between(scores, low, high, step="post", color=pen.colour, alpha=0.15, linewidth=0, zorder=2)
    axis.set(xlim=(0, 100), ylim=(0, 102), ylabel="runs with a higher score, %")
    axis.set_xlabel(f"{_METRICS[group[0].metric]} rate, %")


def improvement_dots(
    improvements: Sequence[Improvement], found: Mapping[str, Pen], settings: Mapping[str, str]
) -> list[Plot]:
    """Make one figure of probabilities of improvement for each setting and metric, a row for each pair."""
    plots = []
    for (setting, metric), group in _grouped(improvements).items():
        values = [(f"{each.column} over {each.base}", f"{percent(each.value)} %") for each in group]
        runs = {each.base: each.base_runs for each in group} | {each.column: each.runs for each in group}
        plots.append(
            Plot(
                partial(_draw_improvements, group=group, found=found),
                title=f"Probability of improvement: {_METRICS[metric]}",
                alt=f"Probability that a run scores higher, {_METRICS[metric]}: {listing(values)}.",
                caption=_caption(settings.get(setting, ""), runs),
                facets={"measure": metric, "setting": setting},
                height=0.5 + 0.26 * len(group),
            )
        )
    return plots


def _draw_improvements(axis: Axes, group: Sequence[Improvement], found: Mapping[str, Pen]) -> None:
    names = [f"{short(each.column)} over {short(each.base)}" for each in group]
    rows = [[((each.value, each.low, each.high), pen_of(found, each.column))] for each in group]
    draw_rows(axis, names, rows)
    axis.set_xlim(-2, 102)
    axis.axvline(50, color=NEUTRAL, linestyle="--", linewidth=1.2, zorder=1)


def _caption(setting: str, runs: Mapping[str, int]) -> str:
    return " ".join(
        [f"{setting}."] * bool(setting) + [f"Runs: {', '.join(f'{n} {c}' for n, c in runs.items())}."]
    )


def _grouped(items: Sequence[Of]) -> dict[tuple[str, str], list[Of]]:
    """By setting and metric."""
    groups: dict[tuple[str, str], list[Of]] = {}
    for each in items:
        groups.setdefault((each.setting, each.metric), []).append(each)
    return groups


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
