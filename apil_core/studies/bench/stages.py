"""Stages that follow a benchmark's trainings."""

from __future__ import annotations

import shutil
from typing import TYPE_CHECKING, Any

from apil_core.common.errors import ApilError
from apil_core.evaluation.progress import Progress
from apil_core.studies.bench.cells import Benchmark, Cell
from apil_core.training.storage.run_dir import RunDir

if TYPE_CHECKING:
    from apil_core.api.profiles import Profile
    from apil_core.evaluation.options import PairingOptions
    from apil_core.runs.retraining.config import RetrainConfig
    from apil_core.studies.bench.jobs import JobStatus
from apil_core.studies.bench.matrix import BASELINE

_TRIES = 60
"""Games searched for one that the adversary wins."""


def harden(status: JobStatus, cell: Cell, threads: int, progress: Progress) -> bool:
    """Retrain the cell's victim against its adversary and the game's baseline; false if it was stopped."""
    from apil_core.runs.retraining.retrain import resume_retraining, retrain
    from apil_core.studies.bench.still_valid import check_same_retraining

    stage, directory = status.benchmark.matrix.retraining, status.bench.retrained_dir(cell.name)
    assert stage is not None
    shared: Any = {"progress": progress, "plugins": status.benchmark.plugins, "command": status.command}
    if RunDir(directory).checkpoints():
        check_same_retraining(directory, stage)
        return resume_retraining(directory, steps=stage.steps, threads=threads, **shared).status == "finished"
    shutil.rmtree(directory, ignore_errors=True)  # killed before its first checkpoint
    run = f"run:{status.bench.cell(cell.name).path.resolve()}"
    config = retraining_of(status.benchmark, cell, run, threads=threads)
    return retrain(config, out=directory, **shared).status == "finished"


def retraining_of(benchmark: Benchmark, cell: Cell, adversary: str, **flags: Any) -> RetrainConfig:
    """Settings of a retraining of the cell's victim against that adversary and the game's baseline."""
    from apil_core.runs.retraining.settings import settings

    assert benchmark.matrix.retraining is not None
    asked = benchmark.matrix.retraining.model_dump(mode="json", exclude={"games", "methods"})
    own = {
        "baseline": benchmark.baselines[cell.game],
        "seed": cell.seed,
        "trust": cell.config.trust,
        "device": cell.config.device,
        # cross-play scores it, against these and all others
        "evaluation.episodes": 0,
    }
    return settings([adversary], {**asked, **own, **flags}, plugins=benchmark.plugins)


def play_all(status: JobStatus, game: str, threads: int, progress: Progress) -> None:
    """Play every adversary of a game against its victims, the retrained ones included."""
    from apil_core.evaluation.crossplay.crossplay import crossplay
    from apil_core.evaluation.crossplay.document import CrossPlay

    stage = status.benchmark.matrix.crossplay
    assert stage is not None
    path = status.bench.crossplay_path(game)
    path.parent.mkdir(parents=True, exist_ok=True)
    if (stored := CrossPlay.stored(path)) is not None:  # the matrix may have been extended since
        status.valid_crossplay(stored, game).write(path)
    crossplay(
        status.adversaries(game),
        status.victims(game),
        _shared(status, game, threads, stage.physics),
        episodes=stage.episodes,
        out=path,
        command=status.command,
        progress=progress,
    )


def map_activations(status: JobStatus, game: str, threads: int, progress: Progress) -> None:
    """Map the activations of the game's first victim against each adversary and in normal play."""
    from apil_core.studies.activations.analysis import analyze
    from apil_core.studies.activations.options import Sampling

    stage = status.benchmark.matrix.activations
    assert stage is not None
    opponents = status.adversaries(game)
    config = status.benchmark.cells_of(game)[0].config
    found = analyze(
        {label: name for label, name in opponents.items() if label != BASELINE},
        _shared(status, game, threads, None),
        victim=config.victim,
        baseline=status.benchmark.baselines.get(game),
        sampling=Sampling(games=stage.episodes),
        progress=progress,
    )
    path = status.bench.activations_path(game)
    path.parent.mkdir(parents=True, exist_ok=True)
    found.write(path)


def _shared(status: JobStatus, game: str, threads: int, physics: Profile | None) -> PairingOptions:
    """Settings with which a game's cells are played against each other."""
    from apil_core.evaluation.options import PairingOptions

    config = status.benchmark.cells_of(game)[0].config
    return PairingOptions(
        like=config,
        env=game,
        seed=config.seed,
        physics=physics,
        adversary_actions=config.evaluation.adversary_actions,
        victim_actions=config.evaluation.victim_actions,
        threads=threads,
        trust=config.trust,
        plugins=status.benchmark.plugins,
    )


def take_snapshots(status: JobStatus, cell: Cell, progress: Progress) -> None:
    """Save a contact sheet of a game the cell's adversary wins; of its first game if it wins none."""
    from apil_core.evaluation.options import RenderOptions
    from apil_core.evaluation.pairing import load_pairing
    from apil_core.evaluation.video.recording import check_files, show

    path = status.bench.snapshot_path(cell.name)
    path.parent.mkdir(parents=True, exist_ok=True)
    stage = status.benchmark.matrix.snapshots
    pictures = 6 if stage is None else stage.pictures
    run = f"run:{status.bench.cell(cell.name).path}"
    options = RenderOptions(
        seed=cell.seed,
        until="win",
        episodes=_TRIES,
        snapshots=pictures,
        contact_sheet=path,
        width=240,
        height=160,
    )
    check_files(options)
    with load_pairing(run, num_envs=1, threads=1, seed=cell.seed) as pairing:
        try:
            show(pairing, options, progress)
        except ApilError:  # it won none
            show(pairing, RenderOptions.of(options, until=None, episodes=None), progress)
