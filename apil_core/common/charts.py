"""Chart style: rcParams, line styles and intervals. matplotlib is imported only when something is drawn."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from apil_core.common import colours
from apil_core.common.colours import Colour
from apil_core.common.errors import ConfigError
from apil_core.common.extras import need
from apil_core.common.files import write_atomically

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

GREY = "#60666f"

MARKERS, DASHES = "osD^vP*", ("-", "--", ":", "-.")

STYLE: dict[str, Any] = {
    "text.parse_math": False,  # a dollar in a path is a dollar
    "svg.fonttype": "none",
    "font.size": 9.5,
    "axes.titlesize": 10,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": GREY,
    "axes.grid": True,
    "grid.color": "#e4e6ea",
    "legend.frameon": False,
}
"""matplotlib's settings, over its defaults."""


FORMATS = (".png", ".svg", ".pdf")
"""File formats of plotted curves."""


def check_picture(path: Path) -> None:
    """Check that curves can be drawn and written to a file of that name.

    Raises:
        ApilError: it cannot, or matplotlib is missing.
    """
    need("matplotlib")
    if path.suffix.lower() not in FORMATS:
        raise ConfigError(f"{path}: curves are drawn as {', '.join(FORMATS[:-1])} or {FORMATS[-1]} files")


def write_picture(path: Path, make: Callable[[], Figure], **style: Any) -> None:
    """Draw a figure into a file, atomically; a file of that name is replaced.

    Args:
        path: of the picture; see :data:`FORMATS`.
        make: draws it, in the style of all charts.
        style: matplotlib's settings, over that style; underscores stand for dots.

    Raises:
        ApilError: the file cannot be written, or not in that format.
    """
    from matplotlib import style as styles

    check_picture(path)
    with styles.context(["default", {**STYLE, **{key.replace("_", "."): v for key, v in style.items()}}]):
        figure, kind = make(), path.suffix[1:].lower()
        write_atomically(path, lambda file: figure.savefig(file, format=kind, dpi=150))


@dataclass(frozen=True)
class Pen:
    """Line style of a group of runs, a method or an opponent: matplotlib colour, dash and marker."""

    colour: str
    dashes: str = "-"
    marker: str = "o"


NORMAL = Pen(GREY, ":", "o")
"""Line style of normal play and other results that no method produced."""


def pens(count: int, palette: Sequence[str] | None = None) -> list[Pen]:
    """That many distinguishable line styles; default: in the colours of :data:`.colours.LINES`."""
    shades = palette or [web(colour) for colour in colours.LINES]
    return [
        Pen(shades[i % len(shades)], DASHES[i // len(shades) % len(DASHES)], MARKERS[i % len(MARKERS)])
        for i in range(count)
    ]


def web(colour: Colour) -> str:
    """As HTML writes it, e.g. ``#2658cc``."""
    return "#{:02x}{:02x}{:02x}".format(*colour)


def whisker(
    axis: Axes,
    at: float,
    ends: tuple[float, float, float],
    pen: Pen,
    *,
    factor: float = 1.0,
    level: bool = False,
    **style: Any,
) -> None:
    """A mark with its interval.

    Args:
        axis: where.
        at: place on x, or on y if ``level``.
        ends: value, low and high.
        pen: of mark and bar.
        factor: of value and interval, e.g. 100 for per cent.
        level: the interval goes from left to right.
        style: over that of :meth:`matplotlib.axes.Axes.errorbar`.
    """
    from matplotlib import rcParams

    value, low, high = (factor * end for end in ends)
    # rounding may put the end of an interval 1e-16 on the wrong side of a share of 0 or 1
    reach: dict[str, Any] = {"xerr" if level else "yerr": [[max(value - low, 0.0)], [max(high - value, 0.0)]]}
    x, y = (value, at) if level else (at, value)
    marks = {
        "markersize": 5.5,
        "markeredgecolor": rcParams["axes.facecolor"],
        "elinewidth": 1.2,
        "capsize": 2.5,
    }
    axis.errorbar(x, y, **reach, fmt=pen.marker, color=pen.colour, zorder=4, **{**marks, **style})
