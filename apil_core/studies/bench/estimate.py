"""Estimate a matrix's cost: step rates and game lengths, measured here for every kind of cell."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from apil_core.api.config import RunConfig
from apil_core.common.errors import RunDirError
from apil_core.studies.bench.cells import Benchmark, Cell
from apil_core.studies.bench.folder import BenchDir
from apil_core.studies.bench.jobs import Job, JobStatus
from apil_core.studies.bench.matrix import ScoreConfig

_GAMES = 64
"""Games played to measure the time of one."""


@dataclass(frozen=True)
class Cost:
    """What is left of a cell, on one worker.

    Attributes:
        steps_per_second: speed of training: of one worker, alone, at the machine's present load.
        rate_from: ``"its run"``, if the cell was started, else ``"measured now"``.
        training_seconds: of its training.
        scoring_seconds: of its scores; of games between a random adversary and the victim, so a guess: games
            of trained adversaries may last shorter or longer.
    """

    steps_per_second: float
    rate_from: str
    training_seconds: float = 0.0
    scoring_seconds: float = 0.0


@dataclass(frozen=True)
class Estimate:
    """Cost of a benchmark on one worker.

    Attributes:
        cells: by name.
        retraining: seconds that are left of it, at the cells' own rates; a guess, too.
    """

    cells: dict[str, Cost]
    retraining: float

    def hours(self, workers: int) -> float:
        """Remaining time in h, if workers neither slowed each other down nor waited."""
        cells = sum(cost.training_seconds + cost.scoring_seconds for cost in self.cells.values())
        return (cells + self.retraining) / workers / 3600


def estimate(
    benchmark: Benchmark,
    status: JobStatus,
    *,
    threads: int,
    jobs: list[Job] | None = None,
    note: Callable[[str], None] = lambda text: None,
) -> Estimate:
    """Measure one cell of each kind; a few seconds for each method in each game.

    Args:
        benchmark: to estimate.
        status: which of its jobs are done.
        threads: physics threads of a worker.
        jobs: of the benchmark, retrainings among them.
        note: called with a description of each measurement.
    """
    from apil_core.runs.dry_run import steps_per_second

    cells: dict[str, Cost] = {}
    known: dict[Any, float] = {}
    for cell in benchmark.cells:
        rate, source = _own_rate(status.bench, cell), "its run"
        if rate is None:
            kind, source = _kind(cell.config), "measured now"
            if kind not in known:
                note(f"measuring {cell.method} in {cell.game}")
                short = cell.config.model_copy(update={"threads": threads, "init_from": None})
                known[kind] = steps_per_second(short, benchmark.plugins)
            rate = known[kind]
        cells[cell.name] = Cost(rate, source)
    lengths: dict[Any, float] = {}
    for cell in benchmark.cells:
        try:
            cost = cells[cell.name]
            cost = replace(cost, training_seconds=_left(status, cell) / cost.steps_per_second)
            cells[cell.name] = cost
            scoring = _scoring(cell, benchmark, status, lengths, threads, note)
            cells[cell.name] = replace(cost, scoring_seconds=scoring)
        except RunDirError as error:  # one damaged cell must not hide the others
            note(f"{cell.name}: {error}")
    hardening = [job for job in jobs or () if job.kind == "retrained" and not status.is_done(job)]
    return Estimate(cells, sum(job.steps / cells[job.subject].steps_per_second for job in hardening))


def _own_rate(bench: BenchDir, cell: Cell) -> float | None:
    last = bench.cell(cell.name).last_metrics()
    seconds, steps = last.get("wall_seconds"), last.get("steps")
    return steps / seconds if seconds and steps else None


def _kind(config: RunConfig) -> str:
    """Key of the cells with equal speed: everything but the seed and the budget."""
    return config.model_dump_json(exclude={"seed", "steps", "evaluation", "checkpoint", "recorders"})


def _left(status: JobStatus, cell: Cell) -> int:
    if status.trained(cell):
        return 0
    return max(cell.steps - int(status.bench.cell(cell.name).last_metrics().get("steps", 0)), 0)


def _scoring(
    cell: Cell,
    benchmark: Benchmark,
    status: JobStatus,
    known: dict[Any, float],
    threads: int,
    note: Callable[[str], None],
) -> float:
    wanted = status.missing_scores(cell) if status.trained(cell) else benchmark.matrix.scores_of(cell.game)
    total = 0.0
    for score in wanted.values():
        kind = (cell.game, cell.victim, score.physics)
        if kind not in known:
            note(f"measuring games of {cell.game}")
            known[kind] = _seconds_per_game(cell, score, benchmark, threads)
        total += known[kind] * score.episodes
    return total


def _seconds_per_game(cell: Cell, score: ScoreConfig, benchmark: Benchmark, threads: int) -> float:
    from apil_core.evaluation.score import evaluate

    config = cell.config
    begin = time.perf_counter()
    evaluate(
        "random",
        episodes=_GAMES,
        seed=cell.seed,
        like=config,
        trust=config.trust,
        physics=score.physics,
        plugins=benchmark.plugins,
        threads=threads,
    )
    return (time.perf_counter() - begin) / _GAMES
