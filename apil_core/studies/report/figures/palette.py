"""Colours of the page's figures, in light and dark mode.

Figures are drawn once, in placeholder colours; in the page's SVG they become CSS variables, which the
style sheet defines for both themes.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import replace

from apil_core.common import charts, colours
from apil_core.common.charts import Pen, web
from apil_core.common.colours import Colour
from apil_core.studies.bench.matrix import BASELINE

_CAUSES: tuple[Colour, ...] = (
    (51, 34, 136),
    (136, 204, 238),
    (17, 119, 51),
    (221, 204, 119),
    (204, 102, 119),
    (68, 170, 153),
    (170, 68, 153),
    (153, 153, 51),
)
"""Colours of causes: Tol's muted scheme, colour-blind safe and different from the methods'."""

_COLOURS: dict[str, Colour] = {
    **{f"line-{i}": colour for i, colour in enumerate(colours.LINES)},
    "line-baseline": colours.NEUTRAL,
    "adversary": colours.ADVERSARY,
    "tie": (158, 163, 171),
    "victim": colours.VICTIM,
    **{f"cause-{i}": colour for i, colour in enumerate(_CAUSES)},
}
_NAMES = ("ink", "muted", "grid", "ground", *_COLOURS)


def placeholder(name: str) -> str:
    """The placeholder colour to draw with; the page replaces it with the CSS variable of that name."""
    return f"#0b{_NAMES.index(name):02x}fe"


def with_variables(style: str) -> str:
    """Return an SVG element's ``style`` with variables for placeholders and for the grey of all charts."""
    named = re.sub(r"#0b([0-9a-f]{2})fe", lambda found: f"var(--{_NAMES[int(found[1], 16)]})", style)
    return named.replace(charts.GREY, "var(--line-baseline)")


def variables() -> list[tuple[str, str, str]]:
    """Name, light and dark value of every colour of figures, in CSS syntax."""
    return [(name, web(colour), web(on_dark(colour))) for name, colour in _COLOURS.items()]


def on_dark(colour: Colour) -> Colour:
    """The same hue, legible on a dark background and distinct from its neighbours; black becomes white."""
    if max(colour) < 40:
        return 236, 238, 242
    red, green, blue = ((3 * channel + 255) // 4 for channel in colour)
    return red, green, blue


CAUSES = tuple(placeholder(f"cause-{i}") for i in range(len(_CAUSES)))
INK, MUTED, GRID, GROUND, NEUTRAL = map(placeholder, ("ink", "muted", "grid", "ground", "line-baseline"))

_GREY = Pen(NEUTRAL, "--", "o")


def pens(names: Iterable[str]) -> dict[str, Pen]:
    """A pen for each name in that order; the baseline is grey, whatever its index."""
    methods = [name for name in dict.fromkeys(names) if name != BASELINE]
    drawn = charts.pens(len(methods), [placeholder(f"line-{i}") for i in range(len(colours.LINES))])
    return {BASELINE: _GREY, **dict(zip(methods, drawn, strict=True))}


def pen_of(found: Mapping[str, Pen], label: str) -> Pen:
    """The pen of a label such as ``apil``, ``vs apil`` or ``apil/s1``; grey if it names no method."""
    for name in (label, label.removeprefix("vs "), label.removeprefix("vs ").split("/")[0]):
        if name in found:
            return found[name]
    return replace(_GREY, dashes=":")
