"""A figure as the page shows it, and what all figures share."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape
from typing import Any

from apil_core.evaluation.results import Rate
from apil_core.studies.report.figures.palette import GRID, GROUND, INK, MUTED
from apil_core.studies.report.models import Share

Spec = dict[str, Any]
"""A plotly figure as plain data: ``data`` and ``layout``.

The tests let plotly's own classes check every name and value; to build figures of them takes seconds.
"""

STEPS: dict[str, Any] = {"rangemode": "tozero", "exponentformat": "SI", "showgrid": False}
"""Of axes of environment steps."""

_AXIS = {"gridcolor": GRID, "zerolinecolor": GRID, "linecolor": MUTED, "automargin": True}


@dataclass(frozen=True)
class Plot:
    """A figure with its words.

    Attributes:
        figure: plotly's; colours are CSS variables.
        title: above it.
        alt: what it shows in words and numbers, for who cannot see it.
        caption: below it, may be empty.
        facets: what the section's selectors choose by, e.g. ``{"game": "sumo-ants", "measure": "win"}``.
        wide: takes the whole row.
    """

    figure: Spec
    title: str
    alt: str
    caption: str = ""
    facets: dict[str, str] = field(default_factory=dict)
    wide: bool = False


def spec(
    traces: Sequence[dict[str, Any]],
    height: int,
    *,
    x: dict[str, Any] | None = None,
    y: dict[str, Any] | None = None,
    **layout: Any,
) -> Spec:
    """A figure in the page's style.

    Args:
        traces: plotly's.
        height: CSS pixels; the width is that of the place.
        x, y: what its axes have beside the style.
        layout: lies over the style.
    """
    return {
        "data": list(traces),
        "layout": {
            "height": height,
            "margin": {"l": 46, "r": 14, "t": 12, "b": 40},
            "paper_bgcolor": "rgba(0, 0, 0, 0)",
            "plot_bgcolor": "rgba(0, 0, 0, 0)",
            "font": {"family": "system-ui, sans-serif", "size": 12, "color": INK},
            "hoverlabel": {"bgcolor": GROUND, "bordercolor": MUTED, "font": {"size": 12, "color": INK}},
            "showlegend": False,
            "xaxis": {**_AXIS, **(x or {})},
            "yaxis": {**_AXIS, **(y or {})},
            **layout,
        },
    }


def axis_title(words: str) -> dict[str, Any]:
    """Of an axis."""
    return {"text": words, "standoff": 8, "font": {"size": 12}}


def text(value: object) -> str:
    """A name for plotly, which reads its labels as a little HTML."""
    return escape(str(value), quote=False)


def percents(shares: Sequence[float]) -> list[float]:
    """Fractions as per cent, to a hundredth."""
    return [round(100 * share, 2) for share in shares]


def rounded(values: Sequence[float]) -> list[float]:
    """To five digits: no screen shows more."""
    return [float(f"{value:.5g}") for value in values]


def error_bar(ends: Sequence[tuple[float, float, float]], colour: str) -> dict[str, Any]:
    """Error bars for plotly, of (value, low, high) each."""
    # rounding may put the end of an interval a hair on the wrong side of its value
    return {
        "type": "data",
        "symmetric": False,
        "array": [round(max(high - value, 0.0), 4) for value, _, high in ends],
        "arrayminus": [round(max(value - low, 0.0), 4) for value, low, _ in ends],
        "color": colour,
        "thickness": 1.4,
        "width": 4,
    }


def in_percent(share: Share | Rate) -> tuple[float, float, float]:
    """Value, low and high of a share."""
    value, low, high = percents([share.value, share.low, share.high])
    return value, low, high


def level(value: float, words: str) -> dict[str, Any]:
    """A dashed line across a figure, with its words: ``shapes`` and ``annotations`` for the layout."""
    line = {"color": "var(--line-baseline)", "dash": "dash", "width": 1.4}
    shape = {"type": "line", "xref": "paper", "x0": 0, "x1": 1, "y0": value, "y1": value, "line": line}
    annotation = {
        "text": text(words),
        "x": 1,
        "xref": "paper",
        "xanchor": "right",
        "y": value,
        "yanchor": "bottom",
        "showarrow": False,
        "font": {"size": 11, "color": MUTED},
    }
    return {"shapes": [shape], "annotations": [annotation]}


def scale_top(highest: float) -> float:
    """End of an axis of per cents that starts at nought: a round number with room above the highest."""
    return min(102.0, 10.0 * math.ceil((highest + 2) / 10))


def listing(pairs: Sequence[tuple[str, str]]) -> str:
    """``apil 31.0 %, e_apil 33.1 %``, for alternative texts."""
    return ", ".join(f"{name} {value}" for name, value in pairs)
