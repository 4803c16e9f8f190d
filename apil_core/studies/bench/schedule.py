"""Schedule the jobs of a benchmark and collect their outcomes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from apil_core.runs.stop_signal import on_stop_signal
from apil_core.studies.bench.cells import Benchmark
from apil_core.studies.bench.executor import Executor
from apil_core.studies.bench.folder import BenchDir
from apil_core.studies.bench.jobs import Job, JobStatus, make_jobs
from apil_core.studies.bench.work import Outcome

State = Literal["waiting", "queued", "running", "done", "failed", "interrupted", "left out"]

_PERIOD = 0.25
"""Seconds between updates."""


class Watch:
    """Callbacks of a running benchmark; the defaults do nothing."""

    def update(self, states: dict[str, State]) -> None:
        """Called a few times a second, and after every end of a job."""

    def ended(self, job: Job, state: State, reason: str) -> None:
        """Called when a job has ended; ``reason`` is that of its failure."""

    def stopping(self, at_once: bool) -> None:
        """Called when a stop is requested: with checkpoints, or, the second time, at once."""

    def close(self) -> None:
        """Called at the end; restores the terminal."""


@dataclass
class BenchResult:
    """The result of a benchmark.

    Attributes:
        states: by name of the job.
        kept: jobs that were done before this session began.
        interrupted: whether it was stopped by the user.
    """

    states: dict[str, State] = field(default_factory=dict)
    kept: tuple[str, ...] = ()
    interrupted: bool = False

    def having(self, state: State) -> list[str]:
        """Jobs with that status."""
        return [name for name, found in self.states.items() if found == state]


def run_benchmark(
    bench: BenchDir,
    benchmark: Benchmark,
    start: Callable[[Path], Executor],
    watching: Callable[[Sequence[Job], JobStatus], Watch] = lambda jobs, status: Watch(),
) -> BenchResult:
    """Do all jobs of a benchmark that are not done yet; see :func:`run_jobs`.

    Args:
        bench: its directory, locked meanwhile; gets the matrix.
        benchmark: resolved.
        start: makes the executor for the directory.
        watching: makes the watch.

    Raises:
        RunDirError: another process is running it.
    """
    jobs, status = make_jobs(benchmark), JobStatus(bench, benchmark)
    with bench.lock():
        bench.write_matrix(benchmark.matrix)
        with closing(watching(jobs, status)) as watch, closing(start(bench.path)) as executor:
            return run_jobs(jobs, status, executor, watch)


def run_jobs(
    jobs: Sequence[Job], status: JobStatus, executor: Executor, watch: Watch | None = None
) -> BenchResult:
    """Run all jobs that are not done yet; a failing one does not stop the others.

    Ctrl-C or SIGTERM lets running jobs write their checkpoints; a second one ends them at once.

    Args:
        jobs: in the order they should be started.
        status: which jobs are done.
        executor: runs them; left open.
        watch: its methods are called on every change.
    """
    scheduler = _Scheduler(jobs, status, executor, watch or Watch())
    try:
        with on_stop_signal(scheduler.ask_to_stop):
            while not scheduler.over:
                scheduler.step()
    except BaseException:
        executor.stop()  # else closing it would wait for all that runs, to the last step
        raise
    return scheduler.result


def jobs_done(jobs: Sequence[Job], status: JobStatus) -> tuple[str, ...]:
    """Names of the jobs that are done.

    A job that uses several cells is not done while one of them still has to train.
    """
    done: list[str] = []
    for job in jobs:
        if all(end in done for end in (*job.needs, *job.after)) and status.is_done(job):
            done.append(job.name)
    return tuple(done)


class _Scheduler:
    def __init__(self, jobs: Sequence[Job], status: JobStatus, executor: Executor, watch: Watch):
        self._jobs = {job.name: job for job in jobs}
        self._status, self._executor, self._watch = status, executor, watch
        kept = jobs_done(jobs, status)
        self.result = BenchResult({name: "done" if name in kept else "waiting" for name in self._jobs}, kept)
        self._futures: dict[Future[Outcome], str] = {}
        self._asked = self._heeded = 0

    def ask_to_stop(self) -> None:
        """Record a request to stop; a signal handler, so it does no more than that."""
        self._asked += 1

    @property
    def over(self) -> bool:
        """True if nothing runs and nothing can be started any more."""
        return not self._futures and (self.result.interrupted or not self.result.having("waiting"))

    def step(self) -> None:
        """Start the jobs that are ready, wait a moment, and record those that ended."""
        if not self.result.interrupted:
            self._start_ready()
        wait(self._futures, timeout=_PERIOD, return_when=FIRST_COMPLETED)
        self._heed()
        # not from wait's result, which lacks cancelled futures: waiters are not notified of those
        for future in [future for future in self._futures if future.done()]:
            self._take(future)
        for future, name in self._futures.items():
            self.result.states[name] = "running" if future.running() else "queued"
        self._watch.update(self.result.states)

    def _heed(self) -> None:
        while self._heeded < self._asked:
            self._heeded += 1
            self.result.interrupted = True
            self._watch.stopping(at_once=self._heeded > 1)
            self._executor.stop()

    def _start_ready(self) -> None:
        states = self.result.states
        for name in self.result.having("waiting"):
            job = self._jobs[name]
            if any(states.get(need) in ("failed", "left out") for need in job.needs):
                states[name] = "left out"
            elif all(states.get(need) == "done" for need in job.needs) and all(
                states.get(end) in ("done", "failed", "left out") for end in job.after
            ):
                # results that arrived meanwhile may have changed its remaining work
                if self._status.is_done(job):
                    states[name] = "done"
                    continue
                states[name] = "queued"
                self._futures[self._executor.submit(name)] = name

    def _take(self, future: Future[Outcome]) -> None:
        name = self._futures.pop(future)
        try:
            outcome = future.result()
        except CancelledError:
            self.result.states[name] = "waiting"
            return
        if outcome == "interrupted" and not self.result.interrupted:
            # the worker was stopped from outside: the cell resumes when the benchmark is run again
            self._status.bench.note_failure(name, "its worker was stopped from outside; run the matrix again")
            outcome = "failed"
        if outcome == "done" and not self._status.is_done(self._jobs[name]):
            self._status.bench.note_failure(name, "its process ended without its result")
            outcome = "failed"
        self.result.states[name] = outcome
        self._watch.ended(self._jobs[name], outcome, self._status.bench.failure(name))
