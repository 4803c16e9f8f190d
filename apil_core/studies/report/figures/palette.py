"""Who has which colour, dash and mark on the page, in light and in dark.

Figures name colours as CSS variables. The style sheet defines them for both themes, and the page's script
gives their values to plotly, so that a figure is stored once and drawn in either.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from apil_core.common import colours
from apil_core.common.colours import Colour

BASELINE = "baseline"
"""Column and opponent that no method made."""

INK, MUTED, GRID, GROUND = (f"var(--{name})" for name in ("ink", "muted", "grid", "ground"))

_DASHES = ("solid", "dash", "dot", "dashdot")
_SYMBOLS = ("circle", "square", "diamond", "triangle-down", "triangle-up", "star", "x")

CAUSES: tuple[Colour, ...] = (
    (51, 34, 136),
    (136, 204, 238),
    (17, 119, 51),
    (221, 204, 119),
    (204, 102, 119),
    (68, 170, 153),
    (170, 68, 153),
    (153, 153, 51),
)
"""Of what ended games: Tol's muted scheme, which colour-blind people can tell apart, and no method has."""

PATTERNS = ("", "/", "", ".", "", "\\", "", "x")
"""Over those colours: neighbours differ without colour too."""

_BANDS = 0.17


@dataclass(frozen=True)
class Pen:
    """How a method is drawn.

    Attributes:
        name: of its CSS variables, e.g. ``line-0``.
        dash, symbol: plotly's names.
    """

    name: str
    dash: str
    symbol: str

    @property
    def colour(self) -> str:
        """Of lines and marks."""
        return f"var(--{self.name})"

    @property
    def band(self) -> str:
        """The same, translucent."""
        return f"var(--{self.name}-band)"


def pens(names: Iterable[str]) -> dict[str, Pen]:
    """A pen for each name in that order; the baseline is grey, whatever its place."""
    methods = [name for name in dict.fromkeys(names) if name != BASELINE]
    count = len(colours.LINES)
    found = {
        name: Pen(f"line-{i % count}", _DASHES[i // count % len(_DASHES)], _SYMBOLS[i % len(_SYMBOLS)])
        for i, name in enumerate(methods)
    }
    return {BASELINE: Pen("line-baseline", "dash", "circle-open"), **found}


def pen_of(found: dict[str, Pen], label: str) -> Pen:
    """The pen of a label such as ``apil``, ``vs apil`` or ``apil/s1``; grey if it names no method."""
    for name in (label, label.removeprefix("vs "), label.removeprefix("vs ").split("/")[0]):
        if name in found:
            return found[name]
    return Pen("line-baseline", "dot", "circle-open")


def variables() -> list[tuple[str, str, str]]:
    """Name, light and dark value of every colour of figures, as CSS writes them."""
    lines = {f"line-{i}": colour for i, colour in enumerate(colours.LINES)}
    lines["line-baseline"] = colours.NEUTRAL
    rows = [row for name, colour in lines.items() for row in _both(name, colour)]
    outcomes = (("adversary", colours.ADVERSARY), ("tie", (158, 163, 171)), ("victim", colours.VICTIM))
    causes = [(f"cause-{i}", colour) for i, colour in enumerate(CAUSES)]
    return rows + [(name, css(colour), css(on_dark(colour))) for name, colour in (*outcomes, *causes)]


def _both(name: str, colour: Colour) -> Sequence[tuple[str, str, str]]:
    dark = on_dark(colour)
    return (
        (name, css(colour), css(dark)),
        (f"{name}-band", css(colour, _BANDS), css(dark, _BANDS)),
    )


def on_dark(colour: Colour) -> Colour:
    """The same hue, legible on a dark ground and still apart from its neighbours; black turns white."""
    if max(colour) < 40:
        return 236, 238, 242
    red, green, blue = ((3 * channel + 255) // 4 for channel in colour)
    return red, green, blue


def css(colour: Colour, opacity: float = 1.0) -> str:
    """As CSS and plotly both read it."""
    red, green, blue = colour
    return f"rgb({red}, {green}, {blue})" if opacity == 1 else f"rgba({red}, {green}, {blue}, {opacity})"
