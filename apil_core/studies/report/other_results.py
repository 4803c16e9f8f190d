"""Other results of benchmarks: retraining curves, cross-plays, activations, pictures."""

from __future__ import annotations

import base64
from pathlib import Path

from apil_core.common.errors import ApilError
from apil_core.runs.retraining.folder import RetrainDir
from apil_core.studies.activations.models import ActivationMap
from apil_core.studies.curves.retraining import read_opponents
from apil_core.studies.report.models import RetrainingCurve, Snapshot
from apil_core.studies.report.sources import Sources
from apil_core.studies.report.training_curves import thinned_group


def retraining_curves(sources: Sources) -> list[RetrainingCurve]:
    """Curves of every started retraining; one that cannot be read has its error as status."""
    return [_retraining(path) for bench, _ in sources.benches.values() for path in bench.retrained()]


def _retraining(path: Path) -> RetrainingCurve:
    game, method, label = path.parts[-3:]
    found = RetrainingCurve(
        game=game, method=method, label=label, steps=0, planned_steps=0, status="", groups=[]
    )
    folder = RetrainDir(path)
    try:
        found.planned_steps = folder.config().steps
        found.status = str((folder.result() or {}).get("status", "running or killed"))
        found.groups = [thinned_group(group) for group in read_opponents(folder)]
        found.steps = found.groups[0].curves[0].steps
    except ApilError as error:  # damaged, or too short for a curve
        found.status = str(error)
    return found


def snapshots(sources: Sources) -> list[Snapshot]:
    """Every contact sheet in ``snapshots/``."""
    found = []
    for bench, _ in sources.benches.values():
        folder = bench.path / "snapshots"
        for path in sorted(folder.glob("**/*.png")):
            game, *between = path.relative_to(folder).with_suffix("").parts
            found.append(
                Snapshot(
                    game=game,
                    method=between[0] if between else "",
                    path=str(path),
                    data_uri=f"data:image/png;base64,{base64.b64encode(path.read_bytes()).decode()}",
                    caption=", ".join([game, *between]),
                )
            )
    return found


def activations(sources: Sources) -> list[ActivationMap]:
    """Every activation map of the benchmarks' games."""
    found = (
        sources.read(ActivationMap.stored, bench.activations_path(game))
        for bench, matrix in sources.benches.values()
        for game in matrix.games
    )
    return [each for each in found if each is not None]
