"""A figure of learning curves: one panel per metric, one colour per group of runs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.ticker import EngFormatter, MaxNLocator

from apil_core.common import colours
from apil_core.common.charts import GREY, Pen, pens, web, whisker, write_picture
from apil_core.studies.curves.captions import Wording, legend
from apil_core.studies.curves.curves import IMITATOR, RETURN, WIN, WIN_OR_TIE, Curve, Line
from apil_core.studies.curves.groups import CurveGroup

TITLES = {
    WIN: "games won by {player}, %",
    WIN_OR_TIE: "games won or tied, %",
    RETURN: "the adversary's return per game",
    IMITATOR: "the imitator's squared error ÷ the best constant's",
}
"""Titles of panels by the name of their lines; other metrics use their own name."""

SHARES = (WIN, WIN_OR_TIE)
_PANEL = (5.2, 3.0)  # inches
_LETTERS = 130  # of the legend's font that fit side by side


def draw_curves(groups: Sequence[CurveGroup], path: Path, wording: Wording | None = None) -> None:
    """Draw groups of runs into one picture, atomically; a file of that name is replaced.

    Args:
        groups: at least one.
        path: of the picture; see :data:`FORMATS`.
        wording: default: each group is an attack.

    Raises:
        ApilError: the file cannot be written, or not in that format.
    """
    write_picture(path, lambda: _figure(groups, wording or Wording.of_runs(groups)))


def _figure(groups: Sequence[CurveGroup], wording: Wording) -> Figure:
    names = list(dict.fromkeys(name for group in groups for name in group.lines))
    rows = math.ceil(len(names) / 2)
    layout = ConstrainedLayoutEngine(w_pad=0.12, h_pad=0.08)
    figure = Figure(figsize=(2 * _PANEL[0], rows * _PANEL[1] + 0.9), layout=layout)
    axes = list(figure.subplots(rows, 2, squeeze=False, sharex=True).flatten())
    drawn = pens(len(groups)) if len(groups) > 1 else [Pen(web(colours.ADVERSARY))]
    for axis, name in zip(axes, names, strict=False):
        draw_panel(axis, name, groups, drawn)
        axis.set_title(TITLES.get(name, name).replace("{player}", wording.player))
    for axis in axes[len(names) :]:
        axis.set_axis_off()
    axes[0].set_xlim(left=_first_step(groups))
    _same_scale(axes[: len(SHARES)])
    _head(figure, axes[0], groups, wording.title)
    figure.supxlabel(wording.explanation, x=0.01, ha="left", fontsize=8, color=GREY)
    return figure


def _first_step(groups: Sequence[CurveGroup]) -> float:
    """First step of the axis: 0, with a margin before it if there are scores."""
    curves = [curve for group in groups for curve in group.curves]
    if any(point.steps == 0 for curve in curves for point in curve.scores):
        return -0.03 * max(curve.steps for curve in curves)
    return 0.0


def _head(figure: Figure, axis: Axes, groups: Sequence[CurveGroup], title: str) -> None:
    """Draw the title, with a legend below it if there are several groups."""
    font = {"size": 12, "weight": "bold"}
    if len(groups) == 1:
        figure.suptitle(title, x=0.01, ha="left", **font)
        return
    handles, labels = axis.get_legend_handles_labels()
    fitting = _LETTERS // (max(map(len, labels)) + 8)
    figure.legend(
        handles,
        labels,
        loc="outside upper left",
        ncols=max(1, min(fitting, len(labels), 4)),
        title=title,
        title_fontproperties=font,
        alignment="left",
    )


def draw_panel(axis: Axes, name: str, groups: Sequence[CurveGroup], drawn: Sequence[Pen]) -> None:
    """Draw the line of that name of every group, single runs behind it, and evaluations on top.

    Args:
        axis: where; environment steps go to the right, shares are in per cent.
        name: of the lines, see :mod:`.curves`; groups without it are left out.
        groups: of runs.
        drawn: a pen for each group.
    """
    factor = 100.0 if name in SHARES else 1.0
    for group, pen in zip(groups, drawn, strict=True):
        if name in group.lines:
            draw_line(axis, group.lines[name], pen, legend(group), factor)
        for curve in group.curves if len(group.curves) > 1 else ():
            _faint(axis, curve, name, factor, pen)
    if name in SHARES:
        _scores(axis, name, groups, drawn)
    if name == IMITATOR:
        axis.axhline(1.0, color=GREY, linewidth=1.2, linestyle=":", zorder=1)
    step_axis(axis)


def step_axis(axis: Axes) -> None:
    """Format the axis of environment steps, as 500k or 2M."""
    axis.set_xlabel("environment steps")
    axis.xaxis.set_major_formatter(EngFormatter(sep=""))
    axis.xaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 2.5, 5, 10]))
    axis.tick_params(labelbottom=True)
    axis.set_axisbelow(True)
    axis.margins(x=0.03)


def draw_line(axis: Axes, line: Line, pen: Pen, label: str, factor: float = 1.0) -> None:
    """Draw a line with its band; a single value is a marker."""
    value, low, high = ([factor * v for v in values] for values in (line.value, line.low, line.high))
    single = pen.marker if len(value) == 1 else None
    style: dict[str, Any] = {"color": pen.colour, "linestyle": pen.dashes, "marker": single, "linewidth": 1.8}
    axis.plot(line.steps, value, label=label, zorder=3, **style)
    if low:
        axis.fill_between(line.steps, low, high, color=pen.colour, alpha=0.15, linewidth=0, zorder=2)


def _faint(axis: Axes, curve: Curve, name: str, factor: float, pen: Pen) -> None:
    line = curve.lines.get(name)
    if line is not None:
        value = [factor * v for v in line.value]
        axis.plot(line.steps, value, color=pen.colour, linewidth=0.7, alpha=0.45, zorder=2)


def _scores(axis: Axes, name: str, groups: Sequence[CurveGroup], drawn: Sequence[Pen]) -> None:
    """Draw evaluations with their intervals, shifted a little where several share a number of steps."""
    span = max(curve.steps for group in groups for curve in group.curves)
    runs = [(curve, pen) for group, pen in zip(groups, drawn, strict=True) for curve in group.curves]
    for i, (curve, pen) in enumerate(runs):
        shift = min(0.012, 0.06 / len(runs)) * span * (i - (len(runs) - 1) / 2)
        for point in curve.scores:
            rate = getattr(point, name)
            whisker(axis, point.steps + shift, (rate.value, rate.low, rate.high), pen, factor=100.0)


def _same_scale(axes: Sequence[Axes]) -> None:
    """Give shares the same scale in all panels, starting at 0."""
    top = min(max(axis.get_ylim()[1] for axis in axes), 103.0)
    for axis in axes:
        axis.set_ylim(0, max(top, 5.0))
