"""Cross-play as a heat map: every adversary against every victim."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from apil_core.studies.report.figures.plot import Plot, axis_title, spec, text
from apil_core.studies.report.models import CrossPlayMatrix, Share
from apil_core.studies.report.words import percent

_MEASURES = {"win": "games won by the adversary", "win_or_tie": "games won or tied by the adversary"}
_SCALE = [[0, "#f3f7fb"], [1, "#004f8a"]]
"""One hue, so that lightness alone tells; numbers stay legible in every field."""

_MANY = 9  # columns beyond which a cell has no room for its interval


def crossplay_maps(matrices: Sequence[CrossPlayMatrix]) -> list[Plot]:
    """One heat map for each game and measure."""
    return [_map(matrix, measure) for matrix in matrices for measure in _MEASURES]


def _map(matrix: CrossPlayMatrix, measure: str) -> Plot:
    shares: list[list[Share | None]] = getattr(matrix, measure)
    many = len(matrix.victims) > _MANY
    trace: dict[str, Any] = {
        "type": "heatmap",
        "z": [[None if share is None else round(100 * share.value, 2) for share in row] for row in shares],
        "x": [text(victim) for victim in matrix.victims],
        "y": [text(adversary) for adversary in matrix.adversaries],
        "text": [[_cell(share, many) for share in row] for row in shares],
        "texttemplate": "%{text}",
        "textfont": {"size": 12},
        "colorscale": _SCALE,
        "zmin": 0,
        "zmax": 100,
        "xgap": 2,
        "ygap": 2,
        "colorbar": {"ticksuffix": " %", "outlinewidth": 0, "thickness": 10, "nticks": 5},
        "hovertemplate": "%{y} against victim %{x}: %{text}<extra></extra>",
    }
    figure = spec(
        [trace],
        96 + 44 * max(len(matrix.adversaries), 2),
        x={"title": axis_title("victim"), "type": "category", "showgrid": False},
        y={"title": axis_title("adversary"), "type": "category", "autorange": "reversed", "showgrid": False},
    )
    return Plot(
        figure,
        title=f"{matrix.game}: {_MEASURES[measure]}, %",
        alt=f"Cross-play in {matrix.game}: {_MEASURES[measure]}. " + " ".join(_words(matrix, shares)),
        caption=f"{matrix.setting}.",
        facets={"game": matrix.game, "measure": measure},
        wide=len(matrix.victims) > _MANY // 2,
    )


def _cell(share: Share | None, narrow: bool) -> str:
    if share is None:
        return ""  # not played yet
    value = percent(share.value)
    return value if narrow else f"{value}<br>{100 * share.low:.0f} – {100 * share.high:.0f}"


def _words(matrix: CrossPlayMatrix, shares: Sequence[Sequence[Share | None]]) -> list[str]:
    return [
        f"{adversary} against "
        + ", ".join(
            f"{victim} not yet" if share is None else f"{victim} {percent(share.value)} %"
            for victim, share in zip(matrix.victims, row, strict=True)
        )
        + "."
        for adversary, row in zip(matrix.adversaries, shares, strict=True)
    ]
