"""An activation map as a picture: the t-SNE on the left, log-likelihoods on the right."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from apil_core.common import colours
from apil_core.common.charts import GREY, STYLE, check_picture
from apil_core.common.files import write_atomically
from apil_core.studies.activations.models import ActivationMap

_MARKERS = "osD^vP*"
_SIZE = (10.4, 5.0)  # inches
_ROW = 0.42  # inches, of an opponent in the right panel


def draw_activations(found: ActivationMap, path: Path, *, methods: Sequence[str] = ()) -> None:
    """Draw a map, atomically; a file of that name is replaced.

    Args:
        found: what is drawn.
        path: of the picture; see :data:`apil_core.common.charts.FORMATS`.
        methods: labels in an order that several pictures share, so that a method has one colour in all of
            them; default: this map's own. Normal play is grey anyway.

    Raises:
        ApilError: the file cannot be written, or not in that format.
    """
    check_picture(path)
    with style.context(["default", STYLE]):
        figure = _figure(found, _pens(found, methods))
        kind = path.suffix[1:].lower()
        write_atomically(path, lambda file: figure.savefig(file, format=kind, dpi=150))


Pen = tuple[tuple[float, ...], str]
"""Colour and marker."""


def _pens(found: ActivationMap, methods: Sequence[str]) -> list[Pen]:
    normal, *others = found.opponents
    order = list(dict.fromkeys([*(name for name in methods if name != normal), *others]))
    pens = [(tuple(channel / 255 for channel in colours.NEUTRAL), "o")]
    for label in others:
        i = order.index(label)
        colour = colours.LINES[i % len(colours.LINES)]
        pens.append((tuple(channel / 255 for channel in colour), _MARKERS[(i + 1) % len(_MARKERS)]))
    return pens


def _figure(found: ActivationMap, pens: Sequence[Pen]) -> Figure:
    height = max(_SIZE[1], _ROW * len(found.opponents) + 1.8)
    layout = ConstrainedLayoutEngine(w_pad=0.12, h_pad=0.08)
    figure = Figure(figsize=(_SIZE[0], height), layout=layout)
    left, right = figure.subplots(1, 2, width_ratios=[1.25, 1])
    _cloud(left, found, pens)
    _likelihood(right, found, pens)
    physics = f", {found.physics} physics" if found.physics else ""
    title = f"Activations of {found.victim} in {found.env}{physics}"
    figure.suptitle(title, x=0.01, ha="left", size=12, weight="bold")
    figure.supxlabel(_explanation(found), x=0.01, ha="left", fontsize=8, color=GREY)
    return figure


def _cloud(axis: Axes, found: ActivationMap, pens: Sequence[Pen]) -> None:
    for label, points, (colour, marker) in zip(found.opponents, found.points, pens, strict=True):
        xs, ys = zip(*points, strict=True)
        axis.scatter(xs, ys, s=9, color=colour, marker=marker, alpha=0.55, linewidths=0, label=label)
    axis.set_title(f"t-SNE of {found.units} units, by opponent")
    axis.set_xticks([])
    axis.set_yticks([])
    axis.set_aspect("equal", "datalim")
    axis.spines[:].set_visible(False)
    axis.legend(loc="upper center", bbox_to_anchor=(0.5, 0), ncols=3, markerscale=2.2, handletextpad=0.2)


def _likelihood(axis: Axes, found: ActivationMap, pens: Sequence[Pen]) -> None:
    for row, (each, (colour, marker)) in enumerate(zip(found.log_likelihood, pens, strict=True)):
        # rounding may put the end of an interval 1e-16 on the wrong side of the mean
        reach = [[max(each.mean - each.low, 0.0)], [max(each.high - each.mean, 0.0)]]
        axis.errorbar(each.mean, row, xerr=reach, fmt=marker, color=colour, markersize=7, capsize=3)
        axis.annotate(
            f"{each.mean:.1f}",
            (each.mean, row),
            (0, 9),
            textcoords="offset points",
            ha="center",
            fontsize=8.5,
        )
    axis.axvline(found.log_likelihood[0].mean, color=GREY, linewidth=1, linestyle=":", zorder=1)
    axis.set_yticks(range(len(found.opponents)), found.opponents)
    axis.set_ylim(len(found.opponents) - 0.5, -0.6)
    axis.margins(x=0.1)
    axis.grid(axis="y", visible=False)
    axis.set_title("log-likelihood under normal play, nats")
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
