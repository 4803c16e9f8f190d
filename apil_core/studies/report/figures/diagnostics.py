"""What trainings logged beside the score, over steps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from apil_core.studies.curves.curves import Line
from apil_core.studies.report.figures.palette import Pen, pen_of
from apil_core.studies.report.figures.plot import STEPS, Plot, axis_title, level, listing, rounded, spec, text
from apil_core.studies.report.models import Diagnostics

TITLES = {
    "kl": "KL between successive adversaries",
    "bound": "bound that this KL implies",
    "imitator_kl": "KL between successive imitators",
}
"""Names of lines in words; others stand for themselves."""

TRIVIAL = "2H, the trivial bound"
"""Fact of a run: what holds without any bound. It is drawn beside the bound, which says nothing above it."""

_DECADES = 100.0  # of the largest by the least value, from which a logarithmic axis reads better


def diagnostic_plots(
    diagnostics: Sequence[Diagnostics], found: dict[str, Pen], settings: dict[str, str]
) -> list[Plot]:
    """One figure for each game, setting and line: all methods and seeds in it."""
    groups: dict[tuple[str, str, str], list[tuple[Diagnostics, Line]]] = {}
    for diagnostic in diagnostics:
        for name, line in diagnostic.lines.items():
            if line.steps:
                groups.setdefault((diagnostic.game, diagnostic.setting, name), []).append((diagnostic, line))
    return [
        _lines(name, group, found, settings.get(setting, ""))
        for (_game, setting, name), group in groups.items()
    ]


def _lines(name: str, group: Sequence[tuple[Diagnostics, Line]], found: dict[str, Pen], setting: str) -> Plot:
    game, setting_id = group[0][0].game, group[0][0].setting
    traces = [_trace(diagnostic, line, pen_of(found, diagnostic.method)) for diagnostic, line in group]
    values = [value for _, line in group for value in line.value]
    y: dict[str, Any] = {"rangemode": "tozero"}
    if min(values) > 0 and max(values) > _DECADES * min(values):
        y = {"type": "log", "exponentformat": "power", "dtick": 1}
    marks: dict[str, Any] = {}
    trivial = [d.facts[TRIVIAL] for d, _ in group if TRIVIAL in d.facts]
    if name == "bound" and trivial:
        marks = level(max(trivial), f"2H = {max(trivial):.3g}, the trivial bound")
    title = TITLES.get(name, name)
    ends = [(f"{d.method}, seed {d.seed}", f"{line.value[-1]:.3g}") for d, line in group]
    return Plot(
        spec(
            traces,
            260,
            x={"title": axis_title("environment steps"), **STEPS},
            y=y,
            hovermode="x unified",
            **marks,
        ),
        title=f"{game}: {title}",
        alt=f"{title} in {game} over steps; at the end {listing(ends)}.",
        caption=setting,
        facets={"game": game, "measure": title, "setting": setting_id},
    )


def _trace(diagnostic: Diagnostics, line: Line, pen: Pen) -> dict[str, Any]:
    return {
        "type": "scatter",
        "x": line.steps,
        "y": rounded(line.value),
        "name": text(f"{diagnostic.method}, seed {diagnostic.seed}"),
        "mode": "lines" if len(line.steps) > 1 else "markers",
        "line": {"color": pen.colour, "dash": pen.dash, "width": 1.7},
        "marker": {"color": pen.colour, "symbol": pen.symbol},
        "hovertemplate": "%{y:.3~g}",
        "meta": {"method": pen.name},
    }
