"""Read directories and collect all data that the report shows."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from apil_core.studies.report import other_results, retrained_tables, warnings
from apil_core.studies.report.ablations import ablations
from apil_core.studies.report.aggregates import aggregates, improvements, profiles
from apil_core.studies.report.attack_tables import attack_tables, columns_of, method_differences
from apil_core.studies.report.claims import claims
from apil_core.studies.report.grouping import group
from apil_core.studies.report.labels import settings
from apil_core.studies.report.models import ReportData, Warning
from apil_core.studies.report.provenance import provenance, unfinished
from apil_core.studies.report.published import published
from apil_core.studies.report.sources import Sources, read_sources
from apil_core.studies.report.table_models import Setting
from apil_core.studies.report.training_curves import curve_panels, diagnostics


def gather(dirs: Sequence[Path], runs: Sequence[Path] = ()) -> ReportData:
    """Read benchmarks and collect the report's data.

    Args:
        dirs: of benchmarks, finished or not; run directories may be among them.
        runs: further single runs.

    Raises:
        ApilError: nothing to report there, or a file is damaged.
    """
    sources = read_sources(dirs, runs)
    groups = group(sources.runs, sources.replayed)
    named = settings(groups)
    games, columns = _games(sources), columns_of(sources)
    attacks = attack_tables(sources, groups, named, games, columns)
    documents = retrained_tables.crossplays(sources)
    defences, further = retrained_tables.retrained_tables(documents, games, columns, len(named) + 1)
    tables, all_settings = [*attacks, *defences], [*named.values(), *further]
    differences = method_differences(tables)
    logged, panels = diagnostics(groups, named), curve_panels(groups, named, attacks, columns)
    mapped, origin = other_results.activations(sources), provenance(sources)
    titles = [matrix.title for _, matrix in sources.benches.values()]
    missing = unfinished(sources, groups.unscored)
    found: list[Warning] = [
        *warnings.setting_warnings(all_settings, tables),
        *warnings.source_warnings(groups, named, missing, attacks),
        *warnings.attack_warnings(attacks, differences, panels, all_settings),
        *warnings.tie_warnings(attacks),
        *warnings.training_warnings(logged),
        *warnings.left_out(groups, sources.replayed),
        *(Warning(kind="damaged", loud=True, text=text) for text in sources.damaged),
    ]
    return ReportData(
        title=next(filter(None, titles), "Adversarial policies, as measured"),
        games=games,
        columns=columns,
        settings=all_settings,
        tables=tables,
        differences=differences,
        aggregates=aggregates(attacks),
        profiles=profiles(attacks),
        improvements=improvements(attacks),
        curves=panels,
        retraining=other_results.retraining_curves(sources),
        ablations=ablations(groups, named, logged),
        crossplay=[played.document for played in documents],
        activations=mapped,
        snapshots=other_results.snapshots(sources),
        diagnostics=logged,
        claims=claims(tables, all_settings),
        warnings=sorted(placed(found, all_settings), key=lambda warning: not warning.loud),
        unfinished=missing,
        provenance=origin,
    )


def placed(warnings: Sequence[Warning], settings: Sequence[Setting]) -> list[Warning]:
    """Each text once, with the setting's description where warnings concern cells of several."""
    cells = {warning.setting for warning in warnings if not warning.loud} - {None}
    labels = {setting.id: setting.label for setting in settings if len(cells) > 1}
    found: dict[str, Warning] = {}
    for warning in warnings:
        placed = not warning.loud and warning.setting in labels
        text = f"{labels[str(warning.setting)]}: {warning.text}" if placed else warning.text
        found.setdefault(text, warning.model_copy(update={"text": text}))
    return list(found.values())


def _games(sources: Sources) -> list[str]:
    """Games in the paper's order, others last."""
    found = sources.games
    return [g for g in published().games if g in found] + [g for g in found if g not in published().games]
