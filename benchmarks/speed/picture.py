"""A figure of speeds: a row for each game and profile, rates on the left, ratios to the base on the right."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.ticker import EngFormatter, NullLocator

from apil_core.common import colours
from apil_core.common.charts import GREY, STYLE
from apil_core.common.colours import Colour
from apil_core.common.files import write_atomically

from .report import CAPTIONS, Level, SpeedReport, SpeedRow, Spread

_PANEL = (5.4, 3.1)  # inches
_BAR = 0.3  # inches
_DASHES = ("-", "--", ":", "-.")
_MARKERS: dict[Level, str] = {
    "physics": "o", "game": "s", "victim": "D", "collection": "^", "training": "v",
}  # fmt: skip
_PLAIN: dict[Level, Colour] = {"physics": colours.NEUTRAL, "game": (150, 156, 166), "victim": colours.VICTIM}
"""Colours of levels without a method; methods have one colour each."""

Series = tuple[Level, str | None, int]
"""Level, method and threads, which identify a line."""


def draw_speed(report: SpeedReport, path: Path) -> None:
    """Draw a report with at least one row, atomically; a file of that name is replaced.

    Args:
        report: the measurements.
        path: of the picture, a PNG.

    Raises:
        RunDirError: the file cannot be written.
    """
    with style.context(["default", STYLE, {"axes.axisbelow": True}]):
        figure = _figure(report)
        write_atomically(path, lambda file: figure.savefig(file, format="png", dpi=150))


def _figure(report: SpeedReport) -> Figure:
    games = list(dict.fromkeys((row.env, row.physics) for row in report.rows))
    wide = len({row.num_envs for row in report.rows}) > 1
    height = len(games) * _PANEL[1] + 1.5 if wide else len(report.rows) * _BAR + len(games) * 0.8 + 0.8
    size = (2 * _PANEL[0], height)
    figure = Figure(figsize=size, layout=ConstrainedLayoutEngine(w_pad=0.12, h_pad=0.08))
    axes = figure.subplots(len(games), 2, squeeze=False)
    for pair, game in zip(axes, games, strict=True):
        rows = [row for row in report.rows if (row.env, row.physics) == game]
        _panel(pair[0], rows, "steps_per_second", wide)
        _panel(pair[1], rows, "ratio", wide)
        name = f"{game[0]} ({game[1]})" if game[1] else game[0]
        pair[0].set_title(f"{name}: environment steps/s")
        base = "the physics' rate" if rows[0].ratio_to == "physics" else "the bare game's rate"
        pair[1].set_title(f"{name}: share of {base}")
    _head(figure, axes, wide)
    figure.supxlabel(_explanation(report), x=0.01, ha="left", fontsize=8, color=GREY)
    return figure


def _head(figure: Figure, axes: Any, wide: bool) -> None:
    """Draw the title, with a legend below it if there are lines."""
    title, font = "How fast everything is beside the physics alone", {"size": 12, "weight": "bold"}
    if not wide:
        figure.suptitle(title, x=0.01, ha="left", **font)
        return
    found: dict[str, Any] = {}
    for axis in axes.flatten():
        handles, labels = axis.get_legend_handles_labels()
        found |= dict(zip(labels, handles, strict=True))
    figure.legend(
        list(found.values()),
        list(found),
        loc="outside upper left",
        ncols=4,
        fontsize=8.5,
        title=title,
        title_fontproperties=font,
        alignment="left",
    )


def _panel(axis: Axes, rows: Sequence[SpeedRow], what: str, wide: bool) -> None:
    """Draw lines over the number of games, or bars if there is one number only."""
    if wide:
        _lines(axis, rows, what)
    else:
        _bars(axis, rows, what)


def _lines(axis: Axes, rows: Sequence[SpeedRow], what: str) -> None:
    methods, threads = _orders(rows)
    for series in dict.fromkeys(_series(row) for row in rows):
        points = sorted((row for row in rows if _series(row) == series), key=lambda row: row.num_envs)
        spreads: list[Spread] = [getattr(point, what) for point in points]
        games = [point.num_envs for point in points]
        colour = _colour(series, methods)
        axis.plot(
            games,
            [spread.median for spread in spreads],
            color=colour,
            linestyle=_DASHES[threads.index(series[2]) % len(_DASHES)],
            linewidth=1.6,
            marker=_MARKERS[series[0]],
            markersize=4.5,
            label=_name(series, several_threads=False) if series[2] == threads[0] else None,  # colours say it
        )
        lows, highs = [s.low for s in spreads], [s.high for s in spreads]
        axis.fill_between(games, lows, highs, color=colour, alpha=0.12, linewidth=0)
    for number, dashes in zip(threads, _DASHES, strict=False) if len(threads) > 1 else ():
        axis.plot([], [], color=GREY, linestyle=dashes, label=_threads(number))
    ticks = sorted({row.num_envs for row in rows})
    axis.set_xscale("log", base=2)
    axis.set_xticks(ticks, [str(tick) for tick in ticks])
    axis.xaxis.set_minor_locator(NullLocator())
    axis.set_xlabel("games stepped together")
    lowest = min(getattr(row, what).low for row in rows)
    axis.set_ylim(bottom=0.5 if what == "ratio" and lowest > 0.55 else 0)
    if what != "ratio":
        axis.yaxis.set_major_formatter(EngFormatter(sep=""))


def _bars(axis: Axes, rows: Sequence[SpeedRow], what: str) -> None:
    methods, threads = _orders(rows)
    names = [_name(_series(row), several_threads=len(threads) > 1) for row in rows]
    spreads: list[Spread] = [getattr(row, what) for row in rows]
    medians = [spread.median for spread in spreads]
    # rounding may put a quartile of equal values on the wrong side of their median
    reach = [[max(s.median - s.low, 0.0) for s in spreads], [max(s.high - s.median, 0.0) for s in spreads]]
    bars = axis.barh(
        range(len(rows)),
        medians,
        xerr=reach,
        color=[_colour(_series(row), methods) for row in rows],
        alpha=0.85,
        error_kw={"elinewidth": 1.2, "capsize": 2.5, "ecolor": "#2b2f36"},
    )
    axis.bar_label(
        bars, [f"{m:.3f}" if what == "ratio" else f"{m:,.0f}" for m in medians], padding=4, fontsize=8.5
    )
    axis.set_yticks(range(len(rows)), names if what != "ratio" else [""] * len(rows))
    axis.invert_yaxis()
    axis.grid(axis="y", visible=False)
    axis.margins(x=0.16)
    if what != "ratio":
        axis.xaxis.set_major_formatter(EngFormatter(sep=""))


def _orders(rows: Sequence[SpeedRow]) -> tuple[list[str], list[int]]:
    """Orders of methods, as given, and of numbers of threads, descending."""
    methods = dict.fromkeys(row.method for row in rows if row.method is not None)
    return list(methods), sorted({row.threads for row in rows}, reverse=True)


def _series(row: SpeedRow) -> Series:
    return row.level, row.method, row.threads


def _name(series: Series, *, several_threads: bool) -> str:
    level, method, threads = series
    parts = [CAPTIONS[level], *([method] if method else [])]
    return ", ".join([*parts, _threads(threads)] if several_threads else parts)


def _threads(number: int) -> str:
    return f"{number} thread{'s' * (number != 1)}"


def _colour(series: Series, methods: Sequence[str]) -> tuple[float, ...]:
    """A method's colour, lighter for its collection."""
    level, method, _ = series
    colour = _PLAIN[level] if method is None else colours.LINES[1 + methods.index(method) % 6]
    white = 0.4 if level == "collection" else 0.0
    return tuple((1 - white) * channel / 255 + white for channel in colour)


def _explanation(report: SpeedReport) -> str:
    """One line that explains the numbers."""
    rows, machine = report.rows, report.machine
    threads = sorted({row.threads for row in rows})
    batch = rows[0].num_envs * rows[0].num_steps
    games = sorted({row.num_envs for row in rows})
    stepped = f"{games[0]} games, " if len(games) == 1 else ""
    return (
        f"medians and quartiles over blocks of {batch:,} steps; {stepped}"
        f"{', '.join(map(str, threads))} thread{'s' * (threads != [1])}; "
        f"{machine.cpu}, {machine.usable_cpus} CPUs"
    )
