"""The effect of one setting: cells that differ in it alone, compared."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from apil_core.studies.report.cells import cell, method_difference, seed_scores
from apil_core.studies.report.grouping import Groups, Scored
from apil_core.studies.report.labels import cell_marks
from apil_core.studies.report.models import Ablation, AblationRow, Diagnostics
from apil_core.studies.report.settings import Key, default_config, value_at
from apil_core.studies.report.table_models import Setting
from apil_core.studies.report.training_curves import RATIO

_TITLES = {"options.apil.prediction": "What ã is: the imitator's prediction, the true action, noise, nothing"}


def ablations(
    groups: Groups, named: Mapping[Key, Setting], diagnostics: Sequence[Diagnostics]
) -> list[Ablation]:
    """Ablations for every axis with two values or more in one game, method and setting; unblinded scores."""
    axes = dict.fromkeys(axis for ms in groups.cells.values() for m in ms for axis in m.run.axes)
    errors = {each.run: each.facts[RATIO] for each in diagnostics if RATIO in each.facts}
    found = []
    for axis in axes:
        cells: dict[tuple[str, str, Key], dict[str, tuple[Key, list[Scored]]]] = {}
        for place, members in groups.cells.items():
            value = value_at(members[0].run.config, axis)
            if place.blind is None and value is not None:
                rest = replace(place.key, axes=tuple(pair for pair in place.key.axes if pair[0] != axis))
                cells.setdefault((place.game, place.method, rest), {})[str(value)] = (place.key, members)
        found += [
            _ablation(axis, game, method, by_value, named, errors)
            for (game, method, _), by_value in cells.items()
            if len(by_value) > 1
        ]
    return found


def _ablation(
    axis: str,
    game: str,
    method: str,
    by_value: Mapping[str, tuple[Key, list[Scored]]],
    named: Mapping[Key, Setting],
    errors: Mapping[str, float],
) -> Ablation:
    default = default_config(next(iter(by_value.values()))[1][0].run.config)
    usual = None if default is None else str(value_at(default, axis))
    rows: list[AblationRow] = []
    setting = ""
    for value in sorted(by_value, key=lambda value: value != usual):
        key, members = by_value[value]
        setting, scores = setting or named[key].id, seed_scores(members)
        own = cell(game, method, scores, None, cell_marks(named[key], game, scores, trained=True))
        row = AblationRow(value=value, cell=own)
        if ratios := [errors[member.run.path] for member in members if member.run.path in errors]:
            row.imitator_error = sum(ratios) / len(ratios)
        if rows:
            row.difference = method_difference(own, rows[0].cell, setting=setting)
        rows.append(row)
    return Ablation(
        axis=axis,
        title=_TITLES.get(axis, axis),
        game=game,
        method=method,
        setting=setting,
        rows=rows,
    )
