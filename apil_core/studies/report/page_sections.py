"""The page's sections in their order: results first, provenance last; empty ones are left out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from apil_core.common.charts import Pen
from apil_core.evaluation.crossplay.document import SHARES
from apil_core.studies.curves.captions import bands
from apil_core.studies.report.figures.activations import activation_plots
from apil_core.studies.report.figures.crossplay import crossplay_map
from apil_core.studies.report.figures.curves import diagnostic_plots, learning_curve, retraining_curve
from apil_core.studies.report.figures.dots import ablated, by_metric, improved, means, performance
from apil_core.studies.report.figures.endings import ending_bars
from apil_core.studies.report.figures.plot import Plot
from apil_core.studies.report.models import ReportData
from apil_core.studies.report.page_tables import Copy, TableView, table_views
from apil_core.studies.report.table_models import METRICS
from apil_core.studies.report.tables import table_texts
from apil_core.studies.report.words import MEASURES

Options = Sequence[tuple[str, str]]
"""Value and label of each choice; values are joined by ``|``, the empty one means all."""

_LEGENDS = {
    "game": "Game",
    "measure": "Measure",
    "setting": "Setting",
    "kind": "Counted by",
    "score": "Score",
}
_BOTH: Options = (("win|win_or_tie", "both"), *list(MEASURES.items())[:2])
_PROFILES = (
    "Performance profile: share of runs that score above a value. Probability of improvement: that of a run "
    "scoring higher than a run of the other method in the same game, 50 % if they are alike. "
    "Bands and bars: 95 % intervals from runs redrawn within their game."
)
_EVERY: Options = (_BOTH[0], *MEASURES.items(), ("", "all"))


@dataclass(frozen=True)
class Facet:
    """A selector; its first option is selected initially."""

    name: str
    legend: str
    options: Options


@dataclass(frozen=True)
class Section:
    """One section of the page.

    Attributes:
        key: its anchor.
        shown: whether it has content other than figures and tables.
        intro: a paragraph above it.
        legend: methods in its figures.
        chosen: options of facets, where not all and each.
    """

    key: str
    title: str
    template: str = "figures"
    shown: bool = False
    intro: str = ""
    plots: Sequence[Plot] = ()
    views: Sequence[TableView] = ()
    copies: Sequence[Copy] = ()
    legend: Sequence[str] = ()
    chosen: Mapping[str, Options] = field(default_factory=dict)

    @property
    def facets(self) -> list[Facet]:
        """Selectors for the properties in which figures differ."""
        facets = []
        for name in dict.fromkeys(name for plot in self.plots for name in plot.facets):
            values = list(dict.fromkeys(plot.facets.get(name, "") for plot in self.plots))
            if len(values) > 1:
                each = [(value, MEASURES.get(value, value)) for value in values]
                options = self.chosen.get(name) or [("", "all"), *each]
                useful = [o for o in options if not o[0] or set(o[0].split("|")) & set(values)]
                facets.append(Facet(name, _LEGENDS[name], useful))
        return facets


def sections(data: ReportData, pens: Mapping[str, Pen]) -> list[Section]:
    """The sections that have data."""
    settings = {setting.id: setting.label for setting in data.settings}
    texts = table_texts(data)
    views = table_views(data, texts)
    first = [view for view in views if view.table.number == 1]
    found = [
        Section("results", "Results", "tables", views=first),
        *_curves(data, pens, settings),
        Section("tables", "Further tables", "tables", views=[view for view in views if view not in first]),
        *_scores(data, pens, settings, texts),
        *_analysis(data, pens, settings),
        Section(
            "claims",
            "Claims of the paper",
            "claims",
            bool(data.claims),
            "“Cannot be told” means that these games are too few, or the budget too short, for a verdict.",
        ),
        Section("provenance", "Provenance", "provenance", True),
    ]
    return [section for section in found if section.shown or section.plots or section.views]


def _curves(data: ReportData, pens: Mapping[str, Pen], settings: dict[str, str]) -> list[Section]:
    groups = [group for panel in data.curves for group in panel.groups]
    methods = {group.curves[0].method for group in groups}
    opponents = {group.label for curve in data.retraining for group in curve.groups}
    return [
        Section(
            "curves",
            "Learning curves",
            intro="Lines: shares of the last 1000 training games, over seeds their mean. "
            f"Bands: {', '.join(bands(groups))}. Points: scores with their 95 % intervals.",
            plots=[
                learning_curve(panel, measure, pens, _if_several(data.curves, settings))
                for panel in data.curves
                for measure in MEASURES
                if any(measure in group.lines for group in panel.groups)
            ],
            legend=[name for name in data.columns if name in methods],
            chosen=_setting_first(settings) | {"measure": _EVERY},
        ),
        Section(
            "retraining",
            "Retraining of the victim",
            intro="Games that the victim won while it was retrained, against each opponent on its own.",
            plots=[
                retraining_curve(curve, measure, pens)
                for curve in data.retraining
                for measure in METRICS
                if curve.groups
            ],
            legend=[name for name in pens if name in opponents],
            chosen={"measure": _BOTH},
        ),
    ]


def _scores(
    data: ReportData, pens: Mapping[str, Pen], settings: dict[str, str], texts: Mapping[str, str]
) -> list[Section]:
    shown = _if_several(data.aggregates, settings)
    files = [file for file in texts if file.startswith(("aggregates", "profiles", "improvements"))]
    attacks = [table for table in data.tables if table.number in (1, 2)]
    return [
        Section(
            "aggregates",
            "Over games and seeds",
            "aggregates",
            intro="The interquartile mean leaves out the lowest and the highest quarter of the scores. "
            + _PROFILES * bool(data.profiles),
            plots=[
                *(means(group, pens, shown) for group in by_metric(data.aggregates)),
                *(performance(group, pens, shown) for group in by_metric(data.profiles)),
                *(improved(group, pens, shown) for group in by_metric(data.improvements)),
            ],
            copies=[Copy(file, texts[file]) for file in files],
            legend=list(dict.fromkeys(each.column for each in data.profiles)),
            chosen=_setting_first(settings) | {"measure": _BOTH},
        ),
        Section(
            "endings",
            "How games ended",
            intro="A high share of “win or tie” may be won or not: look here before you believe it.",
            plots=ending_bars(attacks, _if_several(attacks, settings)),
            chosen=_setting_first(settings),
        ),
        Section(
            "crossplay",
            "Cross-play",
            "crossplay",
            intro="Every adversary against every victim of its game, retrained ones included.",
            plots=[crossplay_map(document, share) for document in data.crossplay for share in SHARES],
            chosen={"measure": _BOTH},
        ),
        Section(
            "ablations",
            "Ablations",
            "ablations",
            intro="Circles: games won; diamonds: won or tied; 95 % intervals. The first row is the default.",
            plots=[ablated(each, _if_several(data.ablations, settings)) for each in data.ablations],
        ),
    ]


def _analysis(data: ReportData, pens: Mapping[str, Pen], settings: dict[str, str]) -> list[Section]:
    opponents = {name for each in data.activations for name in each.opponents}
    logged = {each.method for each in data.diagnostics if each.lines}
    return [
        Section(
            "activations",
            "Activations of the victim",
            intro="A point is the victim’s hidden state at one step. How far apart groups lie means nothing.",
            plots=[plot for each in data.activations for plot in activation_plots(each, pens)],
            legend=[name for name in pens if name in opponents],
        ),
        Section(
            "snapshots",
            "Snapshots",
            "snapshots",
            bool(data.snapshots),
            "Each strip is one game, from left to right. A strip is an example, not a measurement.",
        ),
        Section(
            "diagnostics",
            "Diagnostics",
            "diagnostics",
            bool(data.diagnostics),
            "What the trainings logged beside the score: signs of health, not results.",
            plots=diagnostic_plots(data.diagnostics, pens, _if_several(data.diagnostics, settings)),
            legend=[name for name in data.columns if name in logged],
            chosen=_setting_first(settings),
        ),
    ]


class _Set(Protocol):
    setting: str


def _if_several(items: Sequence[_Set], settings: dict[str, str]) -> dict[str, str]:
    """Labels of settings, if a section has several; otherwise every caption would be the same."""
    return settings if len({item.setting for item in items}) > 1 else {}


def _setting_first(settings: dict[str, str]) -> dict[str, Options]:
    """Show the main setting initially, the others on demand."""
    return {"setting": [*settings.items(), ("", "all")]}
