"""Cross-play as a heat map: one panel for games won, one for games won or tied."""

from __future__ import annotations

from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from apil_core.common import colours
from apil_core.common.charts import GREY, write_picture
from apil_core.common.colours import Colour
from apil_core.evaluation.crossplay.document import SHARES, CrossPlay, Share, share_of

TITLES: dict[Share, str] = {
    "win": "games won by the adversary, %",
    "win_or_tie": "games won or tied by the adversary, %",
}
"""Of panels."""

_CELL = (1.35, 0.62)  # inches
_LETTER = 0.085  # inches, of the labels' font
_DARK = 0.33
"""Largest distance from 50 % of a cell with dark text."""


def draw_crossplay(document: CrossPlay, path: Path) -> None:
    """Draw a document with at least one score, atomically; a file of that name is replaced.

    Args:
        document: the scores; pairings without one are left blank.
        path: of the picture; see :data:`apil_core.common.charts.FORMATS`.

    Raises:
        ApilError: the file cannot be written, or not in that format.
    """
    write_picture(path, lambda: _figure(document), axes_grid=False)


def _figure(document: CrossPlay) -> Figure:
    rows = [player.label for player in document.adversaries]
    columns = [player.label for player in document.victims]
    names = _LETTER * max(map(len, rows))
    cell = max(_CELL[0], _LETTER * max(map(len, columns)) + 0.2)
    size = (max(2 * len(columns) * cell + names + 0.9, 8.6), len(rows) * _CELL[1] + 1.7)
    figure = Figure(figsize=size, layout=ConstrainedLayoutEngine(w_pad=0.12, h_pad=0.08))
    axes = figure.subplots(1, 2, squeeze=False)[0]
    for axis, share in zip(axes, SHARES, strict=True):
        draw_matrix(axis, document, share)
        axis.set_title(TITLES[share])
    axes[1].set(yticklabels=[], ylabel="")
    some = document.played[0]
    physics = f", {some.physics} physics" if some.physics else ""
    figure.suptitle(
        f"Every adversary against every victim in {document.env}{physics}",
        x=0.01,
        ha="left",
        size=12,
        weight="bold",
    )
    facts = f"{some.episodes:,} games a cell, seed {some.seed}. Brackets: Wilson 95 % intervals."
    figure.supxlabel(
        f"{facts} Red: the adversary's games; blue: the victim's.", x=0.01, ha="left", fontsize=8, color=GREY
    )
    return figure


def draw_matrix(axis: Axes, document: CrossPlay, share: Share, ground: str = "white") -> None:
    """Draw one share of every pairing, with its interval; pairings that were not played are left blank.

    Args:
        axis: to draw on.
        document: the scores.
        share: the share to draw.
        ground: colour of the gaps between cells.
    """
    values = [
        [float("nan") if score is None else share_of(score, share).value for score in row]
        for row in document.scores
    ]
    axis.pcolormesh(values, cmap=_colour_map(), vmin=0, vmax=1, edgecolors=ground, linewidth=2)
    for i, row in enumerate(document.scores):
        for j, score in enumerate(row):
            if score is None:
                continue
            rate = share_of(score, share)
            text = f"{100 * rate.value:.1f}\n[{100 * rate.low:.1f}, {100 * rate.high:.1f}]"
            ink = "#1d2127" if abs(rate.value - 0.5) < _DARK else "white"
            axis.text(j + 0.5, i + 0.5, text, ha="center", va="center", fontsize=9, color=ink)
    columns, rows = ([player.label for player in side] for side in (document.victims, document.adversaries))
    axis.set_xticks([j + 0.5 for j in range(len(columns))], columns)
    axis.set_yticks([i + 0.5 for i in range(len(rows))], rows)
    axis.set(xlabel="victim", ylabel="adversary", ylim=(len(rows), 0))
    axis.tick_params(length=0)
    axis.spines[:].set_visible(False)


def _colour_map() -> LinearSegmentedColormap:
    """Colour map of the adversary's share: from the victim's colour over white to the adversary's."""
    white: Colour = (250, 250, 250)
    stops = [
        tuple(channel / 255 for channel in colour) for colour in (colours.VICTIM, white, colours.ADVERSARY)
    ]
    return LinearSegmentedColormap.from_list("sides", stops)
