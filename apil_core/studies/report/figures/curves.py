"""Curves over steps: of adversaries, of retrained victims, and of logged training metrics."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

from apil_core.common.charts import Pen
from apil_core.studies.curves.curves import IMITATOR, RETURN, WIN, WIN_OR_TIE, Line
from apil_core.studies.report.figures.palette import pen_of
from apil_core.studies.report.figures.plot import Plot, level, listing, scale_top
from apil_core.studies.report.models import CurvePanel, Diagnostics, RetrainingCurve
from apil_core.studies.report.table_models import METRICS
from apil_core.studies.report.words import MEASURES, amount, percent

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_AXES = {
    WIN: "games won by the adversary, %",
    WIN_OR_TIE: "games won or tied, %",
    RETURN: "return per game",
    IMITATOR: "squared error ÷ best constant's",
}

_LOGGED = {
    "kl": "KL between successive adversaries",
    "bound": "bound that this KL implies",
    "imitator_kl": "KL between successive imitators",
}
"""Titles of diagnostic lines; others use their own name."""

TRIVIAL = "2H, the trivial bound"
"""Fact of a run: the trivial bound, drawn for reference; a bound above it is uninformative."""

_DECADES = 100.0  # of the largest by the least value, from which a logarithmic axis reads better


def learning_curve(
    panel: CurvePanel, measure: str, found: Mapping[str, Pen], settings: Mapping[str, str]
) -> Plot:
    """Draw a measure of a panel.

    Args:
        panel: a game and setting.
        measure: one that any of its groups has.
        found: pens by method.
        settings: labels by id, where there are several.
    """
    groups = [group for group in panel.groups if measure in group.lines]

    def draw(axis: Axes) -> None:
        from apil_core.studies.curves.picture import draw_panel

        draw_panel(axis, measure, groups, [pen_of(found, group.curves[0].method) for group in groups])
        axis.set_ylabel(_AXES[measure])
        if measure in METRICS:
            # both shares of a game have one scale, from 0, so that they can be compared
            axis.set_ylim(0, scale_top(100 * max(_shares(panel), default=0.0)))
            base = getattr(panel, f"baseline_{measure}")
            if base is not None:
                level(axis, 100 * base, f"baseline {percent(base)} %")

    ends = [(group.label, _last(group.lines[measure], measure in METRICS)) for group in groups]
    return Plot(
        draw,
        title=f"{panel.game}: {MEASURES[measure]}",
        alt=f"Learning curves in {panel.game}, {_AXES[measure]}, over steps; at the end {listing(ends)}.",
        caption=settings.get(panel.setting, ""),
        facets={"game": panel.game, "measure": measure, "setting": panel.setting},
    )


def _shares(panel: CurvePanel) -> Iterable[float]:
    for group in panel.groups:
        for measure in METRICS:
            if measure in group.lines:
                yield from group.lines[measure].high or group.lines[measure].value
            yield from (getattr(point, measure).high for curve in group.curves for point in curve.scores)
    yield from (share for share in (panel.baseline_win, panel.baseline_win_or_tie) if share is not None)


def retraining_curve(curve: RetrainingCurve, measure: str, found: Mapping[str, Pen]) -> Plot:
    """Draw the victim's games against each opponent in a retraining."""
    attack = curve.method if curve.label == curve.method else f"{curve.method} ({curve.label})"

    def draw(axis: Axes) -> None:
        from apil_core.studies.curves.picture import draw_panel

        draw_panel(axis, measure, curve.groups, [pen_of(found, group.label) for group in curve.groups])
        axis.set_ylabel("games won by the victim, %" if measure == WIN else "won or tied by the victim, %")
        axis.set_ylim(0, 102)

    ends = [(f"against {group.label}", _last(group.lines[measure], True)) for group in curve.groups]
    state = "" if curve.steps >= curve.planned_steps else f", {curve.status}"
    return Plot(
        draw,
        title=f"{curve.game}, retrained against {attack}: {MEASURES[measure]}",
        alt=f"The victim's games in {curve.game} while it is retrained against {attack}, "
        f"{MEASURES[measure]}; at the end {listing(ends)}.",
        caption=f"{amount(curve.steps)} of {amount(curve.planned_steps)} steps{state}.",
        facets={"game": curve.game, "measure": measure},
    )


def diagnostic_plots(
    diagnostics: Sequence[Diagnostics], found: Mapping[str, Pen], settings: Mapping[str, str]
) -> list[Plot]:
    """Make one figure for each game, setting and metric, with all methods and seeds."""
    groups: dict[tuple[str, str, str], list[tuple[Diagnostics, Line]]] = {}
    for diagnostic in diagnostics:
        for name, line in diagnostic.lines.items():
            if line.steps:
                groups.setdefault((diagnostic.game, diagnostic.setting, name), []).append((diagnostic, line))
    return [
        _logged(name, group, found, settings.get(setting, ""))
        for (_game, setting, name), group in groups.items()
    ]


def _logged(
    name: str, group: Sequence[tuple[Diagnostics, Line]], found: Mapping[str, Pen], setting: str
) -> Plot:
    game, title = group[0][0].game, _LOGGED.get(name, name)
    trivial = [d.facts[TRIVIAL] for d, _ in group if TRIVIAL in d.facts] if name == "bound" else []

    def draw(axis: Axes) -> None:
        from apil_core.studies.curves.picture import draw_line, step_axis

        for diagnostic, line in group:
            draw_line(axis, line, pen_of(found, diagnostic.method), diagnostic.method)
        values = [value for _, line in group for value in line.value]
        if min(values) > 0 and max(values) > _DECADES * min(values):
            axis.set_yscale("log")
        else:
            axis.set_ylim(bottom=min(0.0, *values))
        if trivial:
            level(axis, max(trivial), "2H, the trivial bound")
        step_axis(axis)

    ends = [(f"{d.method}, seed {d.seed}", f"{line.value[-1]:.3g}") for d, line in group]
    return Plot(
        draw,
        title=f"{game}: {title}",
        alt=f"{title} in {game} over steps; at the end {listing(ends)}.",
        caption=setting if not trivial else f"{setting} 2H, the trivial bound: {max(trivial):.3g}.".strip(),
        facets={"game": game, "measure": title, "setting": group[0][0].setting},
        height=2.6,
    )


def _last(line: Line, share: bool) -> str:
    if not line.value:
        return "without a value"
    return f"{percent(line.value[-1])} %" if share else f"{line.value[-1]:.4g}"
