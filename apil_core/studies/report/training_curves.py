"""Learning curves, and diagnostics of trainings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from apil_core.common.errors import ApilError
from apil_core.studies.bench.matrix import BASELINE
from apil_core.studies.curves.curves import Line, read_curve
from apil_core.studies.curves.groups import CurveGroup, read_groups
from apil_core.studies.report.grouping import Groups
from apil_core.studies.report.models import CurvePanel, Diagnostics
from apil_core.studies.report.settings import Key
from apil_core.studies.report.sources import Run
from apil_core.studies.report.table_models import METRICS, Setting, Table
from apil_core.training.storage.recorders import read_metrics

POINTS = 150
"""Maximum points of a line: more are not visible, and the page stays small."""

_FACTS = {
    "apil/mse": "imitator: squared error",
    "apil/constant_mse": "best constant: squared error",
    "apil/explained_share": "imitator: share explained of what can be",
    "apil/log_likelihood": "imitator: log-likelihood",
    "apil/constant_log_likelihood": "best constant: log-likelihood",
    "apil/discriminator_accuracy_victim": "discriminator: accuracy on the victim",
    "apil/discriminator_accuracy_imitator": "discriminator: accuracy on the imitator",
    "ppo/std": "policy: standard deviation of actions",
}
UNEVEN = "steps with r^α + r^ν ≠ 0, per game"
RATIO = "imitator's squared error over the best constant's"
_LAST = 20
"""Number of rows that a final value averages."""


def curve_panels(
    groups: Groups, named: Mapping[Key, Setting], tables: Sequence[Table], columns: Sequence[str]
) -> list[CurvePanel]:
    """One panel per game and training setting; every run is in one of them."""
    drawn: set[str] = set()
    panels = []
    for key, setting in _as_trained_first(named):
        runs = _runs(groups, key)
        for game in dict.fromkeys(run.config.env for run in runs):
            own = [run for run in runs if run.config.env == game and run.path not in drawn]
            own.sort(key=lambda run: (columns.index(run.config.method), run.config.seed))
            drawn.update(run.path for run in own)
            readable = [run.dir for run in own if _readable(run)]
            if readable:
                lines = [thinned_group(one) for one in read_groups(readable)]
                panels.append(
                    CurvePanel(game=game, setting=setting.id, groups=lines, **_level(tables, setting, game))
                )
    return panels


def _as_trained_first(named: Mapping[Key, Setting]) -> list[tuple[Key, Setting]]:
    """Sort settings with the training's own evaluation settings first: diagnostics are listed with those."""
    return sorted(
        named.items(),
        key=lambda item: item[0].physics not in (None, item[0].trained) or item[0].scored_with != (),
    )


def _runs(groups: Groups, key: Key) -> list[Run]:
    scored = [m.run for place, members in groups.cells.items() if place.key == key for m in members]
    return list({run.path: run for run in [*scored, *(r for k, r in groups.unscored if k == key)]}.values())


def _readable(run: Run) -> bool:
    try:
        read_curve(run.dir)
    except ApilError:  # too short for a curve; it is listed as unfinished
        return False
    return True


def _level(tables: Sequence[Table], setting: Setting, game: str) -> dict[str, float]:
    own = (table for table in tables if table.number == 1 and table.setting == setting.id)
    for cell in (each for table in own for row in table.rows for each in row):
        if (cell.game, cell.column) == (game, BASELINE):
            return {f"baseline_{m}": share.value for m in METRICS if (share := cell.share(m)) is not None}
    return {}


def thinned(line: Line) -> Line:
    """Keep at most :data:`POINTS` of its points, including the first and last."""
    count = len(line.steps)
    if count <= POINTS:
        return line
    kept = np.unique(np.linspace(0, count - 1, POINTS).round().astype(int)).tolist()
    return Line(**{name: [values[i] for i in kept] if values else [] for name, values in line})


def thinned_group(group: CurveGroup) -> CurveGroup:
    """Apply :func:`thinned` to all its lines, those of single runs too."""

    def lines(of: Mapping[str, Line]) -> dict[str, Line]:
        return {name: thinned(line) for name, line in of.items()}

    curves = [curve.model_copy(update={"lines": lines(curve.lines)}) for curve in group.curves]
    return CurveGroup(label=group.label, curves=curves, lines=lines(group.lines))


def diagnostics(groups: Groups, named: Mapping[Key, Setting]) -> list[Diagnostics]:
    """Diagnostics of every run with metrics, in the order of settings."""
    found: dict[str, Diagnostics] = {}
    for key, setting in _as_trained_first(named):
        for run in _runs(groups, key):
            if run.path not in found and (rows := _rows(run)):
                found[run.path] = _diagnostics(run, setting, rows)
    return list(found.values())


def _rows(run: Run) -> list[dict[str, float]]:
    try:
        return read_metrics(run.dir.metrics_path)
    except ApilError:
        return []


def _diagnostics(run: Run, setting: Setting, rows: Sequence[dict[str, float]]) -> Diagnostics:
    facts = {text: value for name, text in _FACTS.items() if (value := _final(rows, name)) is not None}
    notes = []
    own, constant = _final(rows, "apil/mse"), _final(rows, "apil/constant_mse")
    if own is not None and constant:
        facts[RATIO] = own / constant
        notes.append("Below 1 the imitator predicts the victim better than the best constant action does.")
    lines, theory, more_notes = _theory(run)
    facts |= _uneven(rows) | theory
    return Diagnostics(
        game=run.config.env,
        method=run.config.method,
        seed=run.config.seed,
        setting=setting.id,
        run=run.path,
        facts=facts,
        lines=lines,
        notes=[*notes, *more_notes],
    )


def _finite(rows: Sequence[dict[str, float]], name: str) -> list[dict[str, float]]:
    return [row for row in rows if np.isfinite(row.get(name, np.nan))]


def _final(rows: Sequence[dict[str, float]], name: str) -> float | None:
    values = [row[name] for row in _finite(rows, name)][-_LAST:]
    return float(np.mean(values)) if values else None


def _uneven(rows: Sequence[dict[str, float]]) -> dict[str, float]:
    """Steps with Δr ≠ 2 r^α per ended game: those in which the rewards are not opposite."""
    kept = _finite(rows, "reward/uneven_share")
    before = np.array([0, *(row["steps"] for row in kept)])
    games = sum(row["games"] for row in kept)
    uneven = float(np.sum(np.diff(before) * [row["reward/uneven_share"] for row in kept])) if kept else 0.0
    return {UNEVEN: uneven / games} if games else {}


def _theory(run: Run) -> tuple[dict[str, Line], dict[str, float], list[str]]:
    """Results of :mod:`.theory.diagnostics` on the log: lines, facts, notes; KL in bits."""
    from apil_core.studies.theory.diagnostics import diagnose

    try:
        found = diagnose(run.dir)
    except ApilError:  # too short, or without any ended game
        return {}, {}, []
    facts = {
        "H, bound of the victim's value": found.value_bound,
        "2H, the trivial bound": found.trivial_bound,
        "KL below which the bound says more than 2H": found.informative_kl,
        "share of rows below it": found.informative_share,
    }
    return {name: thinned(line) for name, line in found.lines.items()}, facts, found.notes
