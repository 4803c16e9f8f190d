"""Jobs on a Ray cluster whose nodes share a file system and have apil installed."""

from __future__ import annotations

import threading
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

from apil_core.bench.folder import BenchDir
from apil_core.bench.supervised import SupervisedJob
from apil_core.bench.work import Outcome
from apil_core.errors import ApilError
from apil_core.extras import need

_RETRIES = 5
"""Times a job is begun again after its worker or node was lost; each goes on from the last checkpoint."""


class RayExecutor:
    """A Ray task per job. One whose worker or node dies is begun again elsewhere and resumes.

    Args:
        root: the benchmark's directory, the same path on all nodes.
        workers: jobs at a time; ``None``: as many as the cluster has CPUs for.
        threads: physics threads of each, and the CPUs it asks Ray for.
        address: the cluster; ``None``: a new one on this machine, gone when the benchmark ends.

    Raises:
        ApilError: Ray is missing, or there is no cluster at that address.
    """

    def __init__(self, root: Path, workers: int | None, threads: int, address: str | None):
        self._ray = need("ray", "ray", "Ray clusters", extra="ray")
        try:
            # the driver's environment is not the workers': they use what is installed where they are
            self._ray.init(address=address or "local", log_to_driver=False, logging_level="ERROR")
        except (ConnectionError, ValueError, RuntimeError) as error:
            reason = " ".join(str(error).split())
            raise ApilError(f"--address {address}: no Ray cluster there: {reason}") from error
        slots = workers or max(int(self._ray.cluster_resources().get("CPU", 1)) // threads, 1)
        task = self._ray.remote(_work).options(num_cpus=threads, max_retries=_RETRIES)
        self._bench = BenchDir(root)
        self._start = lambda job: task.remote(str(root.resolve()), job, threads)
        self._pool = ThreadPoolExecutor(slots, thread_name_prefix="apil-bench")
        self._running: dict[str, Any] = {}
        self._lock = threading.Lock()
        self._stopping = False

    def submit(self, job: str) -> Future[Outcome]:
        """See :class:`apil_core.bench.executor.Executor`."""
        return self._pool.submit(self._run, job)

    def stop(self) -> None:
        """See :class:`apil_core.bench.executor.Executor`."""
        with self._lock:
            again, self._stopping = self._stopping, True
            for task in self._running.values():
                self._ray.cancel(task, force=again)
        self._pool.shutdown(wait=False, cancel_futures=True)

    def close(self) -> None:
        """See :class:`apil_core.bench.executor.Executor`."""
        self._pool.shutdown(wait=True)
        self._ray.shutdown()

    def _run(self, job: str) -> Outcome:
        with self._lock:
            if self._stopping:
                return "interrupted"
            task = self._running[job] = self._start(job)
        try:
            outcome: Outcome = self._ray.get(task)
        except self._ray.exceptions.TaskCancelledError:
            return "interrupted"
        except self._ray.exceptions.RayError as error:
            if self._stopping:
                return "interrupted"
            reason = f"Ray gave it up after {_RETRIES} more tries: {' '.join(str(error).split())[:300]}"
            self._bench.note_failure(job, reason)
            return "failed"
        finally:
            with self._lock:
                self._running.pop(job, None)
        return outcome


def _work(root: str, job: str, threads: int) -> Outcome:
    """On a worker: run the job in a process of its own, as :class:`LocalProcesses` does.

    If this worker is killed the process notices, writes a checkpoint and ends; its successor waits for that.
    """
    with SupervisedJob(Path(root), job, threads) as process:
        try:
            return process.wait()
        except KeyboardInterrupt:  # Ray's way to cancel
            process.stop()
            return process.wait()
