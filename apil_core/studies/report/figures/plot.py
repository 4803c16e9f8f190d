"""A figure as the page shows it: inline SVG in the page's colours, with its texts."""

from __future__ import annotations

import io
import math
import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

from apil_core.common.charts import STYLE
from apil_core.common.visible import visible
from apil_core.studies.report.figures.palette import GRID, GROUND, INK, MUTED, NEUTRAL, with_variables

if TYPE_CHECKING:
    from markupsafe import Markup
    from matplotlib.axes import Axes

WIDTH = 5.0
"""Width in inches of a figure in half the page's width, at text of 9 points."""

_STYLE: dict[str, Any] = {
    **STYLE,
    "font.size": 9,
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": MUTED,
    "axes.axisbelow": True,
    "axes.facecolor": GROUND,
    "figure.facecolor": "none",
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "xtick.major.size": 2,
    "ytick.major.size": 2,
    "grid.color": GRID,
    "hatch.color": GROUND,
    "hatch.linewidth": 1.6,
    "path.simplify_threshold": 0.3,
}
_SVG = "{http://www.w3.org/2000/svg}"
_LINK = "{http://www.w3.org/1999/xlink}href"
_FAMILY = re.compile(r"(?<=px) '[^;]*|font-family: [^;]*; ")
"""matplotlib's fonts; the page has its own."""


@dataclass(frozen=True)
class Plot:
    """A figure with its texts.

    Attributes:
        draw: draws it on axes, in colours of :mod:`.palette`.
        title: above it.
        alt: its content in words and numbers, for screen readers.
        caption: below it, may be empty.
        facets: values that the section's selectors match, e.g. ``{"game": "sumo-ants", "measure": "win"}``.
        wide: takes the whole row.
        height: in inches, where the width is :data:`WIDTH` or, of a wide one, twice that.
    """

    draw: Callable[[Axes], None]
    title: str
    alt: str
    caption: str = ""
    facets: dict[str, str] = field(default_factory=dict)
    wide: bool = False
    height: float = 2.7

    def svg(self, key: str) -> Markup:
        """The SVG for HTML; ``key`` distinguishes its ids from those of the page's other figures."""
        from markupsafe import Markup
        from matplotlib import style
        from matplotlib.figure import Figure

        stream = io.StringIO()
        with style.context(["default", {**_STYLE, "svg.hashsalt": key}]):
            figure = Figure(figsize=(2 * WIDTH if self.wide else WIDTH, self.height), layout="constrained")
            self.draw(figure.subplots())
            figure.savefig(stream, format="svg", metadata={"Date": None})
        return Markup(
            _inline(visible(stream.getvalue()))
        )  # matplotlib escapes names, and so does ElementTree


def _inline(text: str) -> str:
    """SVG for inlining: with CSS variables and short numbers, without size, ids and metadata."""
    root = ElementTree.fromstring(text)
    for part in ({f"{_SVG}metadata"}, {f"{_SVG}style"}):
        for parent in list(root.iter()):
            for child in [child for child in parent if child.tag in part]:
                parent.remove(child)
    linked = set(re.findall(r'(?:href="|url\()#([^")]+)', text))
    for element in root.iter():
        element.tag = element.tag.removeprefix(_SVG)
        element.attrib = dict(_attributes(element.attrib, linked))
        element.tail = None
        if element.tag != "text":
            element.text = None
    root.attrib = {"viewBox": root.attrib["viewBox"], "focusable": "false"}
    return ElementTree.tostring(root, encoding="unicode")


def _attributes(found: dict[str, str], linked: set[str]) -> Iterator[tuple[str, str]]:
    for name, value in found.items():
        if name == "style":
            style = _FAMILY.sub("", with_variables(value)).replace("font: ", "font-size: ")
            yield name, style.replace(": ", ":").replace("; ", ";")
        elif name == "fill":  # of a hatch's ground; variables are for style only
            yield "style", f"fill:{with_variables(value)}"
        elif name in ("d", "x", "y", "transform"):
            yield name, _short(value)
        elif name != "id" or value in linked:
            yield name.replace(_LINK, "href"), value


def _short(numbers: str) -> str:
    """Round to one decimal: the page has 1.3 pixels to a unit."""
    rounded = re.sub(r"-?\d+\.\d+", lambda number: f"{float(number[0]):.1f}".removesuffix(".0"), numbers)
    return re.sub(r"\s*([MLQCz])\s*", r"\1", rounded.replace("\n", " ")).strip()


def level(axis: Axes, value: float, words: str) -> None:
    """Draw a labelled dashed line across a figure; skip it outside the axis's range."""
    axis.axhline(value, color=NEUTRAL, linestyle="--", linewidth=1.2, zorder=1)
    axis.text(
        *(0.01, value, words),
        transform=axis.get_yaxis_transform(),
        ha="left",
        va="bottom",
        fontsize=8,
        color=MUTED,
        clip_on=True,
    ).set_in_layout(False)


def short(name: str) -> str:
    """Shorten a name to at most 24 letters for an axis; the tables show it in full."""
    return visible(name if len(name) <= 24 else f"{name[:23]}…")


def scale_top(highest: float) -> float:
    """End of an axis of per cents that starts at 0: a round number with a margin above the highest value."""
    return min(102.0, 10.0 * math.ceil((highest + 2) / 10))


def listing(pairs: Iterable[tuple[str, str]]) -> str:
    """Format shares for alternative texts: ``apil 31.0 %, e_apil 33.1 %``."""
    return ", ".join(f"{name} {value}" for name, value in pairs)
