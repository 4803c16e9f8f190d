"""Jobs on a Ray cluster whose nodes share a file system and have apil installed."""

from __future__ import annotations

import os
import platform
import signal
import sys
import threading
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, redirect_stdout
from pathlib import Path
from typing import Any

from apil_core.common.errors import RunDirError
from apil_core.studies.bench.folder import BenchDir
from apil_core.studies.bench.ray_cluster import connect, slots
from apil_core.studies.bench.supervised import SupervisedJob
from apil_core.studies.bench.work import Outcome

_RETRIES = 5
"""Restarts of a job after its worker or node was lost; each resumes from the last checkpoint."""


class RayExecutor:
    """One Ray task per job. If its worker or node dies, it is restarted elsewhere and resumes.

    Args:
        root: the benchmark's directory, the same path on all nodes.
        workers: jobs at a time; ``None``: as many as the cluster has CPUs for now.
        threads: physics threads of each, and the CPUs it requests from Ray.
        address: the cluster; ``None``: a new one on this machine, gone when the benchmark ends.

    Raises:
        ApilError: Ray is missing, there is no cluster at that address, or none of its nodes is large enough.
    """

    def __init__(self, root: Path, workers: int | None, threads: int, address: str | None):
        with ExitStack() as opened:
            # Ray prints messages about lost workers to stdout, which is for results
            opened.enter_context(redirect_stdout(sys.stderr))
            self._ray = connect(address, None if workers is None else workers * threads)
            opened.callback(self._ray.shutdown)
            fitting = slots(self._ray, threads)
            self._opened = opened.pop_all()
        task = self._ray.remote(_work).options(num_cpus=threads, max_retries=_RETRIES)
        self._bench = BenchDir(root)
        self._start = lambda job: task.remote(str(root.resolve()), job, threads, os.getcwd())
        self._pool = ThreadPoolExecutor(workers or fitting, thread_name_prefix="apil-bench")
        self._running: dict[str, Any] = {}
        self._lock = threading.Lock()
        self._stops = 0

    def submit(self, job: str) -> Future[Outcome]:
        """See :class:`apil_core.studies.bench.executor.Executor`."""
        return self._pool.submit(self._run, job)

    def stop(self) -> None:
        """See :class:`apil_core.studies.bench.executor.Executor`."""
        with self._lock:
            self._stops += 1
            for task in self._running.values():
                # force kills the worker; otherwise each cancel passes one stop request on, even the second
                self._ray.cancel(task, force=self._stops > 2)
        self._pool.shutdown(wait=False, cancel_futures=True)

    def close(self) -> None:
        """See :class:`apil_core.studies.bench.executor.Executor`."""
        self._pool.shutdown(wait=True)
        self._opened.close()

    def _run(self, job: str) -> Outcome:
        with self._lock:
            if self._stops:
                return "interrupted"
            task = self._running[job] = self._start(job)
        try:
            outcome: Outcome = self._ray.get(task)
        except self._ray.exceptions.TaskCancelledError:
            return "interrupted"
        except self._ray.exceptions.RayError as error:
            if self._stops:
                return "interrupted"
            self._bench.note_failure(job, self._reason(error))
            return "failed"
        finally:
            with self._lock:
                self._running.pop(job, None)
        return outcome

    def _reason(self, error: Exception) -> str:
        """The reason for a missing outcome: the worker raised, or too many workers were lost."""
        text = " ".join(str(getattr(error, "cause", None) or error).split())[:300]
        if isinstance(error, self._ray.exceptions.RayTaskError):
            return text
        return f"Ray gave it up after {_RETRIES} more tries: {text}"


def _work(root: str, job: str, threads: int, folder: str) -> Outcome:
    """On a worker: run the job in its own process, as ``LocalProcesses`` does.

    If this worker is killed the process notices, writes a checkpoint and ends; its successor waits for that.

    Raises:
        RunDirError: the benchmark's directory is not visible on this node.
    """
    if not BenchDir(root).matrix_path.is_file():
        raise RunDirError(f"{platform.node()} sees no benchmark in {root}: is that a shared file system?")
    here = Path(folder) if Path(folder).is_dir() else None
    # Ray cancels by simulating Ctrl-C, which a cluster started in the background would ignore
    signal.signal(signal.SIGINT, signal.default_int_handler)
    with SupervisedJob(Path(root), job, threads, here) as process:
        while True:
            try:
                return process.wait()
            except KeyboardInterrupt:
                process.stop()
