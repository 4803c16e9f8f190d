"""The page's sections, in their order, and what each says when there is nothing to show."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from apil_core.studies.report.figures.activations import activation_plots
from apil_core.studies.report.figures.curves import learning_curves, retraining_curves
from apil_core.studies.report.figures.diagnostics import diagnostic_plots
from apil_core.studies.report.figures.dots import ablation_dots, aggregate_dots
from apil_core.studies.report.figures.endings import SEEING, ending_bars
from apil_core.studies.report.figures.heat import crossplay_maps
from apil_core.studies.report.figures.palette import Pen
from apil_core.studies.report.models import Evidence
from apil_core.studies.report.page_views import Options, Section

_BOTH: Options = (
    ("win|win_or_tie", "both"),
    ("win", "win"),
    ("win_or_tie", "win or tie"),
)
_EVERY: Options = (*_BOTH, ("return", "return"), ("imitator", "imitator’s error"), ("", "all"))


def sections(evidence: Evidence, pens: dict[str, Pen]) -> list[Section]:
    """All of them, those without data included."""
    settings = {setting.id: setting.label for setting in evidence.settings}
    return [
        Section("overview", "Overview", "sections/overview.html.j2"),
        Section(
            "claims",
            "Claims of the paper",
            "sections/claims.html.j2",
            missing="" if evidence.claims else "No claim could be checked on these cells.",
            intro=[
                "“Cannot be told” means that these games are too few, or the budget too short, for a verdict."
            ],
        ),
        Section(
            "warnings",
            "Warnings",
            "sections/warnings.html.j2",
            missing="" if evidence.warnings or evidence.unfinished else "None.",
        ),
        Section(
            "tables",
            "Tables beside the published ones",
            "sections/tables.html.j2",
            missing="" if evidence.tables else "No cell has a score yet.",
        ),
        *_training(evidence, pens, settings),
        *_analysis(evidence, pens, settings),
        Section("provenance", "Provenance", "sections/provenance.html.j2"),
    ]


def _training(evidence: Evidence, pens: dict[str, Pen], settings: dict[str, str]) -> list[Section]:
    curves = learning_curves(evidence.curves, pens, _told(evidence.curves, settings))
    methods = {line.method for panel in evidence.curves for line in panel.lines}
    bands = list(dict.fromkeys(line.band for panel in evidence.curves for line in panel.lines))
    return [
        Section(
            "aggregates",
            "Over all games",
            "sections/aggregates.html.j2",
            missing="" if evidence.aggregates else "No method was scored in every game of a setting.",
            intro=["The interquartile mean leaves out the lowest and the highest quarter of the scores."],
            plots=aggregate_dots(evidence.aggregates, pens, _told(evidence.aggregates, settings)),
        ),
        Section(
            "curves",
            "Learning curves",
            missing="" if curves else "No run has logged enough games for a curve.",
            intro=[
                "Lines: shares of the last 1000 training games, over seeds their mean. "
                f"Bands: {'; '.join(bands)}. Points: scores with their 95 % intervals.",
            ],
            plots=curves,
            legend=[name for name in evidence.columns if name in methods],
            chosen=_setting_first(settings) | {"measure": _EVERY},
        ),
        Section(
            "retraining",
            "Retraining of the victim",
            missing="" if evidence.retraining else "No victim was retrained.",
            intro=["Games that the victim won while it was hardened, against each opponent on its own."],
            plots=retraining_curves(evidence.retraining, pens),
            legend=_opponents(evidence, pens),
            chosen={"measure": _BOTH},
        ),
        Section(
            "endings",
            "How games ended",
            missing="" if evidence.endings else "No cell has a score yet.",
            intro=["A high share of “win or tie” may be won or not: look here before you believe it."],
            plots=ending_bars(evidence.endings, _scores(evidence), _told(evidence.endings, settings)),
            chosen=_setting_first(settings),
        ),
    ]


def _analysis(evidence: Evidence, pens: dict[str, Pen], settings: dict[str, str]) -> list[Section]:
    clouds = {cloud.opponent for a in evidence.activations for cloud in a.clouds}
    lines = diagnostic_plots(evidence.diagnostics, pens, _told(evidence.diagnostics, settings))
    return [
        Section(
            "crossplay",
            "Cross-play",
            "sections/crossplay.html.j2",
            missing="" if evidence.crossplay else "No cross-play was run.",
            intro=["Every adversary against every victim of its game, hardened ones included."],
            plots=crossplay_maps(evidence.crossplay),
            chosen={"measure": _BOTH},
        ),
        Section(
            "ablations",
            "Ablations",
            "sections/ablations.html.j2",
            missing="" if evidence.ablations else "Nothing was varied.",
            intro=[
                "Filled: games won. Open: won or tied. With 95 % intervals; the first row is the default."
            ],
            plots=ablation_dots(evidence.ablations, _told(evidence.ablations, settings)),
        ),
        Section(
            "activations",
            "Activations of the victim",
            missing="" if evidence.activations else "No activations were recorded.",
            intro=[
                "A point is the victim’s hidden state at one step. How far apart groups lie means nothing."
            ],
            plots=activation_plots(evidence.activations, pens),
            legend=[name for name in pens if name in clouds],
        ),
        Section(
            "snapshots",
            "Snapshots",
            "sections/snapshots.html.j2",
            missing="" if evidence.snapshots else "No strips were drawn.",
            intro=["Each strip is one game, from left to right. A strip is an example, not a measurement."],
        ),
        Section(
            "diagnostics",
            "Diagnostics",
            "sections/diagnostics.html.j2",
            missing="" if evidence.diagnostics else "No run logged diagnostics.",
            intro=["What the trainings logged beside the score: signs of health, not results."],
            plots=lines,
            legend=[n for n in evidence.columns if n in {d.method for d in evidence.diagnostics if d.lines}],
            chosen=_setting_first(settings),
        ),
    ]


class _Set(Protocol):
    setting: str


def _told(items: Sequence[_Set], settings: dict[str, str]) -> dict[str, str]:
    """Labels of settings, if a section has several; of a single one every caption would say the same."""
    return settings if len({item.setting for item in items}) > 1 else {}


def _scores(evidence: Evidence) -> dict[str, str]:
    """What the adversary saw, by table."""
    return {t.id: f"blinded: {t.blind}" if t.blind else SEEING for t in evidence.tables}


def _setting_first(settings: dict[str, str]) -> dict[str, Options]:
    """The main setting is shown first, the others on demand."""
    return {"setting": [*settings.items(), ("", "all")]}


def _opponents(evidence: Evidence, pens: dict[str, Pen]) -> list[str]:
    found = {line.opponent for curve in evidence.retraining for line in curve.lines}
    return [name for name in pens if name in found]
