"""Learning curves of adversaries, and of victims that are retrained."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from apil_core.studies.curves.curves import IMITATOR, RETURN, WIN, WIN_OR_TIE, Line
from apil_core.studies.report.figures.palette import GROUND, Pen, pen_of
from apil_core.studies.report.figures.plot import (
    STEPS,
    Plot,
    Spec,
    axis_title,
    error_bar,
    in_percent,
    level,
    listing,
    percents,
    rounded,
    scale_top,
    spec,
    text,
)
from apil_core.studies.report.models import CurveLine, CurvePanel, RetrainingCurve
from apil_core.studies.report.words import amount, percent

MEASURES = {
    WIN: "win",
    WIN_OR_TIE: "win or tie",
    RETURN: "return",
    IMITATOR: "imitator's error",
}
"""Lines that learning curves are drawn of, and their names on the page."""

_AXES = {
    WIN: "games won by the adversary, %",
    WIN_OR_TIE: "games won or tied, %",
    RETURN: "return per game",
    IMITATOR: "squared error ÷ best constant's",
}
_SHARES = (WIN, WIN_OR_TIE)
_HEIGHT = 270


def learning_curves(
    panels: Sequence[CurvePanel], found: dict[str, Pen], settings: dict[str, str]
) -> list[Plot]:
    """One figure for each panel and measure that has data.

    Args:
        panels: games and settings.
        found: pens by method.
        settings: labels by id, where there are several.
    """
    return [
        _learning(panel, measure, found, settings)
        for panel in panels
        for measure in MEASURES
        if any(measure in line.lines for line in panel.lines)
    ]


def _learning(panel: CurvePanel, measure: str, found: dict[str, Pen], settings: dict[str, str]) -> Plot:
    lines = [line for line in panel.lines if measure in line.lines]
    is_share = measure in _SHARES
    traces = [
        trace
        for line in lines
        for trace in _curve(line.lines[measure], pen_of(found, line.method), line.label, is_share)
    ]
    y: dict[str, Any] = {"rangemode": "tozero"} if measure == IMITATOR else {}
    marks: dict[str, Any] = {}
    if is_share:
        traces += [_evaluations(line, measure, pen_of(found, line.method)) for line in lines if line.scores]
        base = getattr(panel, f"baseline_{measure}")
        marks = {} if base is None else level(round(100 * base, 2), f"baseline {percent(base)} %")
        y = {"range": [0, _top(panel)]}
    elif measure == IMITATOR:
        marks = level(1.0, "the best constant")
    ends = [(line.label, _last(line.lines[measure], is_share)) for line in lines]
    return Plot(
        _axes(traces, _AXES[measure], y, marks),
        title=f"{panel.game}: {MEASURES[measure]}",
        alt=f"Learning curves in {panel.game}, {_AXES[measure]}, over steps; at the end {listing(ends)}.",
        caption=settings.get(panel.setting, ""),
        facets={"game": panel.game, "measure": measure, "setting": panel.setting},
    )


def retraining_curves(curves: Sequence[RetrainingCurve], found: dict[str, Pen]) -> list[Plot]:
    """One figure for each retraining and measure: the victim's games against each opponent."""
    return [_retraining(curve, measure, found) for curve in curves for measure in _SHARES if curve.lines]


def _retraining(curve: RetrainingCurve, measure: str, found: dict[str, Pen]) -> Plot:
    attack = curve.method if curve.label == curve.method else f"{curve.method} ({curve.label})"
    drawn = [(line.opponent, getattr(line, measure)) for line in curve.lines]
    traces = [
        trace
        for opponent, line in drawn
        for trace in _curve(line, pen_of(found, opponent), f"against {opponent}", True)
    ]
    words = "games won by the victim, %" if measure == WIN else "won or tied by the victim, %"
    ends = [(f"against {opponent}", _last(line, True)) for opponent, line in drawn]
    state = "" if curve.steps >= curve.planned_steps else f", {curve.status}"
    return Plot(
        _axes(traces, words, {"range": [0, 102]}, {}),
        title=f"{curve.game}, hardened against {attack}: {MEASURES[measure]}",
        alt=f"The victim's games in {curve.game} while it is hardened against {attack}, "
        f"{MEASURES[measure]}; at the end {listing(ends)}.",
        caption=f"{amount(curve.steps)} of {amount(curve.planned_steps)} steps{state}.",
        facets={"game": curve.game, "measure": measure},
    )


def _axes(traces: Sequence[dict[str, Any]], title: str, y: dict[str, Any], marks: dict[str, Any]) -> Spec:
    return spec(
        traces,
        _HEIGHT,
        x={"title": axis_title("environment steps"), **STEPS},
        y={"title": axis_title(title), **y},
        hovermode="x unified",
        **marks,
    )


def _curve(line: Line, pen: Pen, label: str, is_share: bool) -> list[dict[str, Any]]:
    values = percents if is_share else rounded
    common: dict[str, Any] = {"type": "scatter", "x": line.steps, "meta": {"method": pen.name}}
    edge = {**common, "mode": "lines", "line": {"width": 0}, "hoverinfo": "skip"}
    band = [
        {**edge, "y": values(line.low)},
        {**edge, "y": values(line.high), "fill": "tonexty", "fillcolor": pen.band},
    ]
    middle = {
        **common,
        "y": values(line.value),
        "name": text(label),
        "mode": "lines" if len(line.steps) > 1 else "markers",
        "line": {"color": pen.colour, "dash": pen.dash, "width": 2},
        "marker": {"color": pen.colour, "symbol": pen.symbol, "size": 8},
        "hovertemplate": "%{y:.1f} %" if is_share else "%{y:.4~g}",
    }
    return [*(band if line.low else []), middle]


def _evaluations(line: CurveLine, measure: str, pen: Pen) -> dict[str, Any]:
    """Scores of single agents, with their intervals."""
    ends = [in_percent(getattr(point, measure)) for point in line.scores]
    return {
        "type": "scatter",
        "x": [point.steps for point in line.scores],
        "y": [value for value, _, _ in ends],
        "error_y": error_bar(ends, pen.colour),
        "mode": "markers",
        "name": text(f"{line.label}, scored"),
        "marker": {
            "color": pen.colour,
            "symbol": pen.symbol,
            "size": 8,
            "line": {"color": GROUND, "width": 1},
        },
        "hovertemplate": "%{y:.1f} %",
        "meta": {"method": pen.name},
    }


def _top(panel: CurvePanel) -> float:
    """Both shares of a game have one scale, from nought, so that they can be compared."""
    return scale_top(100 * max(_shares(panel), default=0.0))


def _shares(panel: CurvePanel) -> Iterable[float]:
    for line in panel.lines:
        for measure in _SHARES:
            if measure in line.lines:
                yield from line.lines[measure].high or line.lines[measure].value
            yield from (getattr(point, measure).high for point in line.scores)
    yield from (share for share in (panel.baseline_win, panel.baseline_win_or_tie) if share is not None)


def _last(line: Line, share: bool) -> str:
    if not line.value:
        return "without a value"
    return f"{percent(line.value[-1])} %" if share else f"{line.value[-1]:.4g}"
