"""Small benchmarks on the toy game, and what tests do with them."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import psutil

from apil_core.studies.bench.cells import resolve_matrix
from apil_core.studies.bench.folder import BenchDir, read_score
from apil_core.studies.bench.jobs import JobStatus, make_jobs
from apil_core.studies.bench.matrix import Matrix
from apil_core.studies.bench.work import Outcome, perform
from apil_core.training.storage.recorders import read_metrics

TIMINGS = {"wall_seconds", "steps_per_second", "collect_seconds", "update_seconds", "memory_mb"}
"""Metrics in which two runs of the same thing differ."""


def small_matrix(**changes: Any) -> Matrix:
    """ADRL, one seed, six iterations, 20 games of scoring."""
    base: dict[str, Any] = {
        "methods": ["adrl"],
        "games": ["toy-pursuit"],
        "steps": 6 * 512,
        "config": {
            "num_envs": 32,
            "ppo": {"num_steps": 16, "epochs": 2, "minibatches": 2},
            "evaluation": {"episodes": 0},
            "checkpoint": {"every_iterations": 1},
            "recorders": ["jsonl"],
        },
        "scores": {"plain": {"episodes": 20}},
    }
    return Matrix(**{**base, **changes})


def made(root: Path, matrix: Matrix) -> JobStatus:
    """A benchmark's directory in which nothing is done yet."""
    benchmark = resolve_matrix(matrix)
    bench = BenchDir(root)
    bench.write_matrix(benchmark.matrix)
    return JobStatus(bench, benchmark)


class Here:
    """An executor that does jobs in this very process, at once."""

    def __init__(self, root: Path):
        self._root = root

    def submit(self, job: str) -> Future[Outcome]:
        future: Future[Outcome] = Future()
        try:
            future.set_result(perform(self._root, job))
        except Exception:
            future.set_result("failed")
        return future

    def stop(self) -> None:
        pass

    def close(self) -> None:
        pass


def undisturbed(root: Path, matrix: Matrix) -> JobStatus:
    """The same benchmark done in one go."""
    status = made(root, matrix)
    for job in make_jobs(status.benchmark):
        assert perform(root, job.name) == "done"
    return status


def outcome(status: JobStatus) -> dict[str, Any]:
    """All a benchmark's cells have learnt and scored, timings aside; rows in the order of the file."""
    found: dict[str, Any] = {}
    for name in status.cells:
        run = status.bench.cell(name)
        rows = [{k: v for k, v in row.items() if k not in TIMINGS} for row in read_metrics(run.metrics_path)]
        score = read_score(run.path, "plain")
        found[name] = (rows, score.wins, score.ties, score.losses)
    return found


def rows_of(status: JobStatus, job: str) -> int:
    """Lines of a cell's log so far."""
    path = status.bench.cell(job.partition("/")[2]).metrics_path
    return path.read_text().count("\n") if path.is_file() else 0


def process_of(status: JobStatus, job: str) -> psutil.Process:
    """The process that is at a job now."""
    found = []
    for process in psutil.process_iter(["cmdline"]):
        words = process.info["cmdline"] or []
        if job in words and "work" in words and str(status.bench.path) in words:
            found.append(process)
    assert len(found) == 1, f"{len(found)} processes are at {job}"
    return found[0]


def until(condition: Callable[[], Any], seconds: float = 120.0) -> None:
    """Wait for something to come true."""
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "waited too long"
        time.sleep(0.05)
