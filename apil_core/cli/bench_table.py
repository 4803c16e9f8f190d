"""Displays of ``apil bench run``: the plan, the live table and the result."""

from __future__ import annotations

import sys
import time
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from rich.live import Live
from rich.table import Table

from apil_core.cli.output import console, print_json, say, table
from apil_core.cli.readout import duration, outcomes
from apil_core.studies.bench.jobs import CELL, RETRAINING, Job, JobStatus
from apil_core.studies.bench.schedule import BenchResult, State, Watch, jobs_done
from apil_core.training.storage.run_dir import RunDir

if TYPE_CHECKING:
    from apil_core.studies.bench.cells import Benchmark, Cell
    from apil_core.studies.bench.estimate import Estimate

_BETWEEN = 2.0
"""Seconds between reads of the directories of running cells."""

_STOPPING = {
    False: "stopping: what runs finishes its iteration and writes a checkpoint (once more: at once)",
    True: "stopping at once",
}


class LineWatch(Watch):
    """Prints one line on stderr per finished job."""

    def __init__(self, jobs: Sequence[Job], status: JobStatus):
        self._total = len(jobs)
        self._ended = 0
        kept = len(jobs_done(jobs, status))
        say(f"{self._total} jobs in {status.bench.path}, {kept} of them done before")
        self._kept = kept

    def ended(self, job: Job, state: State, reason: str) -> None:
        """See :class:`Watch`."""
        self._ended += 1
        why = f": {reason}" if reason else ""
        count = f"{self._kept + self._ended} of {self._total}"
        say(f"{time.strftime('%H:%M:%S')} {count}: {job.name} {state}{why}")

    def stopping(self, at_once: bool) -> None:
        """See :class:`Watch`."""
        say(_STOPPING[at_once])


class TableWatch(Watch):
    """A live table of running jobs, with counts of waiting, finished and failed ones."""

    def __init__(self, jobs: Sequence[Job], status: JobStatus):
        self._jobs = {job.name: job for job in jobs}
        self._status = status
        self._live = Live(console=console(stderr=True), refresh_per_second=2, transient=True)
        self._next = 0.0
        self._live.start()

    def update(self, states: dict[str, State]) -> None:
        """See :class:`Watch`."""
        if time.monotonic() < self._next:
            return
        self._next = time.monotonic() + _BETWEEN
        self._live.update(self._table(states))

    def ended(self, job: Job, state: State, reason: str) -> None:
        """See :class:`Watch`."""
        why = f": {reason}" if reason else ""
        self._live.console.print(f"{job.name} {state}{why}", markup=False)

    def stopping(self, at_once: bool) -> None:
        """See :class:`Watch`."""
        self._live.console.print(_STOPPING[at_once])

    def close(self) -> None:
        """See :class:`Watch`."""
        self._live.stop()

    def _table(self, states: dict[str, State]) -> Table:
        shown = table("job", "steps>", "win>", "tie>", "steps/s>", "left>")
        counts = Counter(states.values())
        shown.caption = ", ".join(f"{count} {state}" for state, count in counts.items())
        for name, state in states.items():
            if state == "running":
                shown.add_row(name, *self._progress(self._jobs[name]))
        return shown

    def _progress(self, job: Job) -> list[str]:
        metrics = _metrics(self._status, job)
        steps, speed = int(metrics.get("steps", 0)), metrics.get("steps_per_second", 0.0)
        if not job.steps or not steps:
            return [""] * 5
        shares = outcomes(metrics)
        left = duration((job.steps - steps) / speed) if speed and steps < job.steps else "scoring"
        return [
            f"{steps / 1e6:.2f} M of {job.steps / 1e6:.2f} M",
            *(shares.get(name, "").partition(" [")[0] for name in ("win", "tie")),
            f"{speed:,.0f}",
            left,
        ]


def make_watch(jobs: Sequence[Job], status: JobStatus, *, quiet: bool) -> Watch:
    """Make the watch for ``--quiet`` and the kind of terminal."""
    if quiet:
        return Watch()
    return TableWatch(jobs, status) if sys.stderr.isatty() else LineWatch(jobs, status)


def _metrics(status: JobStatus, job: Job) -> dict[str, Any]:
    with suppress(FileNotFoundError):  # one killed before its first checkpoint starts over
        if job.kind == CELL:
            return status.bench.cell(job.subject).last_metrics()
        if job.kind == RETRAINING:
            return RunDir(status.bench.retrained_dir(job.subject)).last_metrics()
    return {}


def print_plan(
    benchmark: Benchmark,
    jobs: Sequence[Job],
    status: JobStatus,
    cost: Estimate,
    workers: int,
    *,
    as_json: bool,
) -> None:
    """Print the cells of a matrix and their estimated cost."""
    states = {cell.name: _state(status, cell) for cell in benchmark.cells}
    others = Counter(job.kind for job in jobs if job.kind != CELL)
    if as_json:
        cells = [
            {
                **{"name": cell.name, "state": states[cell.name], "steps": cell.steps, "victim": cell.victim},
                **asdict(cost.cells[cell.name]),
            }
            for cell in benchmark.cells
        ]
        print_json({"cells": cells, "other_jobs": others, "workers": workers, "hours": cost.hours(workers)})
        return
    rows = [
        (
            *(cell.name, states[cell.name], cell.victim, f"{cell.steps:,}"),
            *(f"{own.steps_per_second:,.0f}", own.rate_from),
            *(duration(own.training_seconds), duration(own.scoring_seconds)),
        )
        for cell in benchmark.cells
        for own in [cost.cells[cell.name]]
    ]
    columns = ("cell", "state", "victim", "steps>", "steps/s>", "rate", "training>", "scoring>")
    shown = table(*columns, rows=rows)
    screen = console()
    screen.print(shown)
    besides = ", ".join(f"{count} × {kind}" for kind, count in others.items())
    steps = sum(cell.steps for cell in benchmark.cells)
    screen.print(f"{len(benchmark.cells)} cells, {steps:,} steps; besides: {besides or 'nothing'}")
    screen.print(
        f"left: about {cost.hours(workers):.1f} h on {workers} worker{'s' * (workers != 1)} if they do not "
        "slow each other down, games of adversaries not trained here, cross-play, activations and pictures "
        "not counted"
    )


def _state(status: JobStatus, cell: Cell) -> str:
    if status.trained(cell):
        return "scoring left" if status.missing_scores(cell) else "done"
    return "begun" if status.bench.cell(cell.name).checkpoints() else "new"


def print_result(result: BenchResult, status: JobStatus, seconds: float, *, as_json: bool) -> None:
    """Print the counts, every failure with its reason, and the next command."""
    bench = status.bench
    failures = {name: bench.failure(name) for name in result.having("failed")}
    counts = Counter(result.states.values())
    if as_json:
        print_json(
            {
                "directory": str(bench.path),
                "jobs": result.states,
                "kept": result.kept,
                "failures": failures,
                "interrupted": result.interrupted,
                "wall_seconds": seconds,
            }
        )
        return
    screen = console()
    if failures:
        screen.print(table("failed", "why", rows=failures.items()))
    summary = ", ".join(f"{count} {state}" for state, count in counts.items())
    screen.print(f"{summary} ({len(result.kept)} were done before) in {duration(seconds)}")
    if not result.interrupted:
        screen.print(f"report: apil bench report {bench.path}")
