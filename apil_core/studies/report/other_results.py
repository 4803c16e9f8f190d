"""What else benchmarks hold: retraining curves, activations, pictures."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from pathlib import Path

from apil_core.common.errors import ApilError
from apil_core.runs.retraining.folder import RetrainDir
from apil_core.studies.activations.models import ActivationMap
from apil_core.studies.curves.curves import WIN, WIN_OR_TIE, shares
from apil_core.studies.report.courses import thinned
from apil_core.studies.report.models import (
    ActivationCloud,
    Activations,
    RetrainingCurve,
    RetrainingLine,
    Snapshot,
)
from apil_core.studies.report.sources import Sources
from apil_core.studies.report.words import percent, several
from apil_core.training.storage.recorders import read_metrics


def retraining_curves(sources: Sources) -> list[RetrainingCurve]:
    """Of every retraining that was started; one that cannot be read has its error as status."""
    folders = [path for bench, _ in sources.benches.values() for path in bench.retrained()]
    found = []
    for path in folders:
        try:
            found.append(_retraining(path))
        except ApilError as error:
            found.append(_damaged(path, str(error)))
    return found


def _retraining(path: Path) -> RetrainingCurve:
    folder = RetrainDir(path)
    config, rows = folder.config(), read_metrics(folder.files.metrics_path)
    return RetrainingCurve(
        game=config.env,
        method=path.parent.name,
        label=path.name,
        steps=int(rows[-1]["steps"]) if rows else 0,
        planned_steps=config.steps,
        status=str((folder.result() or {}).get("status", "running or killed")),
        lines=[_opponent(rows, label) for label in config.labels],
    )


def _damaged(path: Path, error: str) -> RetrainingCurve:
    game, method, label = path.parts[-3:]
    return RetrainingCurve(
        game=game, method=method, label=label, steps=0, planned_steps=0, status=f"damaged: {error}", lines=[]
    )


def _opponent(rows: Sequence[dict[str, float]], label: str) -> RetrainingLine:
    lines = shares(rows, f"opponent/{label}/")
    return RetrainingLine(opponent=label, win=thinned(lines[WIN]), win_or_tie=thinned(lines[WIN_OR_TIE]))


def snapshots(sources: Sources) -> list[Snapshot]:
    """Every strip of pictures below ``snapshots/``."""
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


def activations(sources: Sources) -> list[Activations]:
    """Every activation map of the benchmarks' games.

    Raises:
        ConfigError: a document is damaged.
    """
    paths = [
        bench.activations_path(game) for bench, matrix in sources.benches.values() for game in matrix.games
    ]
    return [_activations(ActivationMap.read(path)) for path in paths if path.is_file()]


def _activations(found: ActivationMap) -> Activations:
    lost = [1.0 - each.explained for each in found.log_likelihood]
    physics = f", {found.physics} physics" if found.physics else ""
    notes = [
        f"{several(found.games_per_opponent, 'game')} against each opponent{physics}; t-SNE with perplexity "
        f"{found.perplexity:g}.",
        f"Density of normal play: a mixture of {several(found.components, 'Gaussian')} in {found.dimensions} "
        f"directions with {percent(found.explained)} % of its variance; up to {percent(max(lost))} % of an "
        "opponent's deviation lies outside them and does not count.",
        f"The samples it was fitted on have {found.fitted:.1f} nats; held-out normal play much below that "
        "would mean too few games.",
    ]
    clouds = [
        ActivationCloud(
            opponent=label,
            points=points,
            log_likelihood=likelihood.mean,
            low=likelihood.low,
            high=likelihood.high,
            games=likelihood.n,
        )
        for label, points, likelihood in zip(found.opponents, found.points, found.log_likelihood, strict=True)
    ]
    return Activations(game=found.env, victim=found.victim, layer=found.layer, clouds=clouds, notes=notes)
