"""Do the missing parts of one job of a benchmark; a job can be restarted at any time."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from apil_core.api.config import RunConfig
from apil_core.common.errors import ConfigError, RunDirError, failures
from apil_core.common.files import locked
from apil_core.config.resolve import differences
from apil_core.evaluation.progress import Progress
from apil_core.studies.bench import jobs
from apil_core.studies.bench.cells import Benchmark, Cell, resolve_matrix
from apil_core.studies.bench.folder import BenchDir, write_score
from apil_core.studies.bench.jobs import Job, JobStatus, make_jobs
from apil_core.studies.bench.matrix import BASELINE, ScoreConfig
from apil_core.training.storage.run_dir import RunDir

if TYPE_CHECKING:
    from apil_core.evaluation.options import EvaluationOptions
    from apil_core.plugins.discovery import PluginRegistry

Outcome = Literal["done", "interrupted", "failed"]

_PATIENCE = 600.0
"""Seconds to wait for a lock; longer than any iteration on usable machines."""

_NEWEST = ("recorders", "log_rows", "checkpoint", "evaluation")
"""Settings that a begun cell takes from the matrix as it is now."""

_FREE = ("threads", "device", "trust", "victim_sha256", *_NEWEST)
"""Settings in which a cell's stored run may differ from the matrix."""


def perform(root: Path, name: str, *, threads: int = 1, progress: Progress | None = None) -> Outcome:
    """Do the missing parts of a job.

    Args:
        root: the benchmark's directory.
        name: the job's.
        threads: of the physics; never changes results.
        progress: gets iterations, scores and notes.

    Raises:
        ApilError: it cannot be done; the benchmark's directory remembers why.
    """
    bench = BenchDir(root)
    try:
        benchmark = resolve_matrix(bench.matrix(), str(bench.matrix_path))
        job = next((job for job in make_jobs(benchmark) if job.name == name), None)
        if job is None:
            raise ConfigError(f"{root} has no job {name!r}")
        with _alone(bench, name):
            bench.note_failure(name, "")
            done = _Worker(bench, benchmark, threads, progress or Progress()).do(job)
    except failures() as error:
        bench.note_failure(name, " ".join(str(error).split()) or type(error).__name__)
        raise
    return "done" if done else "interrupted"


@contextmanager
def _alone(bench: BenchDir, name: str) -> Iterator[None]:
    """Lock a job: a process whose supervisor has died may still be writing its last checkpoint.

    Raises:
        RunDirError: the lock was not released in time.
    """
    bench.logs.mkdir(parents=True, exist_ok=True)
    message = f"another process has been at {name} for {_PATIENCE:.0f} s more"
    with locked(bench.logs / f".{name.replace('/', '_')}.lock", message, patience=_PATIENCE):
        yield


class _Worker:
    """One process's view of the benchmark during a job."""

    def __init__(self, bench: BenchDir, benchmark: Benchmark, threads: int, progress: Progress):
        self.bench = bench
        self.benchmark = benchmark
        self.status = JobStatus(bench, benchmark)
        self.threads = threads
        self.progress = progress

    def do(self, job: Job) -> bool:
        """Return whether the job was completed; false after Ctrl-C or SIGTERM."""
        from apil_core.studies.bench import stages

        match job.kind:
            case jobs.CELL:
                return self._cell(self.status.cells[job.subject])
            case jobs.BASELINES:
                self._replay(*job.subject.split(" ", 1))
            case jobs.ADVERSARIES:
                game, label, victim = job.subject.split(" ", 2)
                self._replay(game, victim, label)
            case jobs.RETRAINING:
                cell = self.status.cells[job.subject]
                return stages.harden(self.status, cell, self.threads, self.progress)
            case jobs.CROSSPLAY:
                stages.play_all(self.status, job.subject, self.threads, self.progress)
            case jobs.ACTIVATIONS:
                stages.map_activations(self.status, job.subject, self.threads, self.progress)
            case jobs.SNAPSHOTS:
                stages.take_snapshots(self.status, self.status.cells[job.subject], self.progress)
        return True

    def _cell(self, cell: Cell) -> bool:
        run = self.bench.cell(cell.name)
        if not self.status.trained(cell) and not self._train(cell, run):
            return False
        missing = self.status.missing_scores(cell)
        self._score(f"run:{run.path}", missing, run.path, cell.seed)
        return True

    def _train(self, cell: Cell, run: RunDir) -> bool:
        from apil_core.runs import runner

        command = self.status.command
        if run.checkpoints():
            stored = run.config()
            check_same(stored, cell)
            kept = {key: getattr(cell.config, key) for key in _NEWEST}
            run.write_config(stored.model_copy(update=kept), self.benchmark.plugins)
            self.bench.set_aside(cell.name)
            result = runner.resume(
                run.path, threads=self.threads, steps=cell.steps, progress=self.progress, command=command
            )
        elif any(run.checkpoint_dir.glob("*.pt*")):
            raise RunDirError(
                f"{run.path} has no checkpoint to go on from, but others; move it away to begin anew"
            )
        else:
            # killed before its first checkpoint: its iterations will be the same again, to the bit
            shutil.rmtree(run.path, ignore_errors=True)
            config = cell.config.model_copy(update={"threads": self.threads})
            result = runner.run(
                config, out=run.path, progress=self.progress, command=command, plugins=self.benchmark.plugins
            )
        return result.status == "finished"

    def _replay(self, game: str, victim: str, label: str = BASELINE) -> None:
        """Score an adversary that is no cell's."""
        config = next(c.config for c in self.benchmark.cells_of(game) if c.victim == victim)
        folder = self.bench.adversary_dir(game, victim, label)
        missing = self.status.missing_of(game, victim, label)
        self._score(self.benchmark.adversaries(game)[label], missing, folder, config.seed, config)

    def _score(
        self,
        adversary: str,
        scores: Mapping[str, ScoreConfig],
        folder: Path,
        seed: int,
        config: RunConfig | None = None,
    ) -> None:
        """Play and store scores; ``config`` has the game and settings where ``adversary`` is no cell's."""
        from apil_core.evaluation.options import EvaluationOptions
        from apil_core.evaluation.score import evaluate

        for name, wanted in scores.items():
            options = EvaluationOptions(
                **wanted.model_dump(exclude={"games"}), seed=seed, threads=self.threads
            )
            if config is not None:
                options = in_games_of(config, adversary, options, self.benchmark.plugins)
            result = evaluate(adversary, options, progress=self.progress)
            write_score(folder, name, result)


def in_games_of(
    config: RunConfig, adversary: str, options: EvaluationOptions, plugins: PluginRegistry
) -> EvaluationOptions:
    """Options with which an adversary that is no cell's plays a cell's games, without its observers."""
    from apil_core.evaluation.options import EvaluationOptions
    from apil_core.training.export.run_policy import run_path

    changes: dict[str, Any] = {"trust": config.trust, "plugins": plugins}
    if run_path(adversary) is None:
        return EvaluationOptions.of(options, like=config.model_copy(update={"observers": ()}), **changes)
    modes = config.evaluation
    return EvaluationOptions.of(
        options,
        env=config.env,
        victim=config.victim,
        game_options=config.game,
        adversary_actions=options.adversary_actions or modes.adversary_actions,
        victim_actions=options.victim_actions or modes.victim_actions,
        **changes,
    )


def check_same(stored: RunConfig, cell: Cell) -> None:
    """Check that a run on disk is the cell the matrix asks for.

    Raises:
        ConfigError: it was trained with other settings.
    """
    changed = {
        key: values
        for key, values in differences(stored, cell.config).items()
        if key.split(".")[0] not in _FREE and not (key == "steps" and values[0] <= values[1])
    }
    if set(changed) == {"steps"}:
        raise ConfigError(
            f"cell {cell.name} has been raised to {stored.steps} steps, the matrix says {cell.steps}; "
            f"go on with --steps {stored.steps}"
        )
    if changed:
        key, (before, now) = next(iter(changed.items()))
        more = f" and {len(changed) - 1} more" if len(changed) > 1 else ""
        raise ConfigError(
            f"cell {cell.name} was begun with {key} {before!r}, the matrix says {now!r}{more}; "
            "give the changed matrix another --out"
        )
