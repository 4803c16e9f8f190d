"""An activation map as a picture: the t-SNE on the left, log-likelihoods on the right."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path as FilePath

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.patches import PathPatch
from matplotlib.path import Path

from apil_core.common.charts import GREY, NORMAL, Pen, pens, whisker, write_picture
from apil_core.studies.activations.models import ActivationMap

_SIZE = (10.4, 5.0)  # inches
_ROW = 0.42  # inches, of an opponent in the right panel


def draw_activations(found: ActivationMap, path: FilePath, *, methods: Sequence[str] = ()) -> None:
    """Draw a map, atomically; a file of that name is replaced.

    Args:
        found: the map to draw.
        path: of the picture; see :data:`apil_core.common.charts.FORMATS`.
        methods: labels in an order that several pictures share, so that a method has one colour in all of
            them; default: this map's own. Normal play is grey anyway.

    Raises:
        ApilError: the file cannot be written, or not in that format.
    """
    write_picture(path, lambda: _figure(found, _pens(found, methods)))


def _pens(found: ActivationMap, methods: Sequence[str]) -> list[Pen]:
    normal, *others = found.opponents
    order = list(dict.fromkeys([*(name for name in methods if name != normal), *others]))
    known = dict(zip(order, pens(len(order)), strict=True))
    return [NORMAL, *(known[label] for label in others)]


def _figure(found: ActivationMap, drawn: Sequence[Pen]) -> Figure:
    height = max(_SIZE[1], _ROW * len(found.opponents) + 1.8)
    layout = ConstrainedLayoutEngine(w_pad=0.12, h_pad=0.08)
    figure = Figure(figsize=(_SIZE[0], height), layout=layout)
    left, right = figure.subplots(1, 2, width_ratios=[1.25, 1])
    draw_map(left, found, drawn)
    left.set_title(f"t-SNE of {found.units} units, by opponent")
    keys = [
        Line2D([], [], color=pen.colour, marker="o", linestyle="", label=label)
        for label, pen in zip(found.opponents, drawn, strict=True)
    ]
    left.legend(handles=keys, loc="upper center", bbox_to_anchor=(0.5, 0), ncols=3, handletextpad=0.2)
    draw_likelihood(right, found, drawn)
    right.set_title("log-likelihood under normal play, nats")
    physics = f", {found.physics} physics" if found.physics else ""
    title = f"Activations of {found.victim} in {found.env}{physics}"
    figure.suptitle(title, x=0.01, ha="left", size=12, weight="bold")
    figure.supxlabel(_explanation(found), x=0.01, ha="left", fontsize=8, color=GREY)
    return figure


def draw_map(axis: Axes, found: ActivationMap, drawn: Sequence[Pen]) -> None:
    """Draw the t-SNE, one colour per opponent.

    All points of one are one path of short strokes with round ends: as marks they make an SVG far larger.
    """
    span = max(max(map(abs, point)) for points in found.points for point in points)
    for points, pen in zip(found.points, drawn, strict=True):
        ends = [end for x, y in points for end in ((x, y), (x + 1e-3 * span, y))]
        dots = Path(ends, [Path.MOVETO, Path.LINETO] * len(points))
        patch = PathPatch(dots, fill=False, lw=3, ec=pen.colour, alpha=0.6, capstyle="round")
        patch.set_snap(False)  # snapped to a pixel, two of three strokes have no length and vanish
        axis.add_patch(patch)
    axis.set_xticks([])
    axis.set_yticks([])
    axis.set_aspect("equal", "datalim")
    axis.autoscale_view()
    axis.spines[:].set_visible(False)


def draw_likelihood(axis: Axes, found: ActivationMap, drawn: Sequence[Pen]) -> None:
    """Draw mean log-likelihoods with their intervals, one row per opponent."""
    for row, (each, pen) in enumerate(zip(found.log_likelihood, drawn, strict=True)):
        whisker(axis, row, (each.mean, each.low, each.high), pen, level=True, markersize=7, capsize=3)
        text = axis.annotate(
            f"{each.mean:.1f}".replace("-", "−"), (each.mean, row), (0, 9), textcoords="offset points"
        )
        text.set(horizontalalignment="center", fontsize=8.5)
    axis.axvline(found.log_likelihood[0].mean, color=GREY, linewidth=1, linestyle=":", zorder=1)
    axis.set_yticks(range(len(found.opponents)), found.opponents)
    axis.set_ylim(len(found.opponents) - 0.5, -0.6)
    axis.margins(x=0.1)
    axis.grid(axis="y", visible=False)
    axis.set_xlabel("less usual  ←  mean over games  →  more usual")


def _explanation(found: ActivationMap) -> str:
    points = sum(map(len, found.points))
    several = f"{found.components} components" if found.components > 1 else "one component"
    return (
        f"{found.games_per_opponent} games against each, seed {found.seed}; {points:,} points, perplexity "
        f"{found.perplexity:g}. Bars: 95 % intervals, bootstrap over games.\nDensity: Gaussian mixture of "
        f"{several} over {found.dimensions} principal directions ({100 * found.explained:.1f} % of the "
        f"variance) of {found.games_per_opponent} other games of normal play."
    )
