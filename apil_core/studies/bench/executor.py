"""The interface of executors, and the default one: worker processes on this machine."""

from __future__ import annotations

import threading
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Protocol

from apil_core.studies.bench.folder import BenchDir
from apil_core.studies.bench.supervised import SupervisedJob
from apil_core.studies.bench.work import Outcome


class Executor(Protocol):
    """Runs jobs of one benchmark, each at most once at a time."""

    def submit(self, job: str) -> Future[Outcome]:
        """Start the job of that name when a worker is free.

        The future gives how it ended. It never raises for errors in the job: the benchmark's
        directory remembers that.
        """

    def stop(self) -> None:
        """Ask running jobs to stop with a checkpoint and drop waiting ones; the second call stops at once."""

    def close(self) -> None:
        """Wait for running jobs, and release all workers."""


class LocalProcesses:
    """One process per job, so that a crash cannot affect the others.

    Args:
        root: the benchmark's directory.
        workers: processes at a time.
        threads: physics threads of each.
    """

    def __init__(self, root: Path, workers: int, threads: int):
        self._root = root
        self._threads = threads
        self._pool = ThreadPoolExecutor(workers, thread_name_prefix="apil-bench")
        self._running: set[SupervisedJob] = set()
        self._lock = threading.Lock()
        self._stopping = False

    def submit(self, job: str) -> Future[Outcome]:
        """See :class:`Executor`."""
        return self._pool.submit(self._run, job)

    def stop(self) -> None:
        """See :class:`Executor`."""
        with self._lock:
            self._stopping = True
            for process in self._running:
                process.stop()
        self._pool.shutdown(wait=False, cancel_futures=True)

    def close(self) -> None:
        """See :class:`Executor`."""
        self._pool.shutdown(wait=True)

    def _run(self, job: str) -> Outcome:
        with self._lock:
            if self._stopping:
                return "interrupted"
            try:
                process = SupervisedJob(self._root, job, self._threads)
            except OSError as error:
                BenchDir(self._root).note_failure(job, f"cannot be started: {error}")
                return "failed"
            self._running.add(process)
        with process:
            try:
                return process.wait()
            finally:
                with self._lock:
                    self._running.discard(process)
