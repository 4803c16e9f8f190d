"""A job in its own process, which stops with a checkpoint when its supervisor is gone."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from apil_core.common.trust import FLAG
from apil_core.studies.bench.folder import BenchDir
from apil_core.studies.bench.work import Outcome

_INTERRUPTED = 130
"""Exit code of a process that was asked to stop and left a checkpoint."""

_BETWEEN = 0.1
"""Seconds between checks whether it has ended."""


def start_supervised(words: Sequence[str], **options: Any) -> subprocess.Popen[bytes]:
    """Start ``apil WORDS`` in a process that stops with a checkpoint when this one ends or lets go.

    Args:
        words: a command that follows its supervisor (cli/bench_work.py); what it loads was checked here.
        options: of ``subprocess.Popen``.

    Raises:
        OSError: no process can be started.
    """
    return subprocess.Popen(
        [sys.executable, "-P", "-m", "apil_core.cli", *words, FLAG],
        # one tracker run cannot hold several trainings
        env={key: value for key, value in os.environ.items() if key != "WANDB_RUN_ID"},
        # its other end closes when this process ends, even if killed
        stdin=subprocess.PIPE,
        # Ctrl-C reaches the supervisor only, so that each process gets one signal on any terminal
        start_new_session=True,
        **options,
    )


class SupervisedJob:
    """A running job; a context manager.

    Args:
        root: the benchmark's directory.
        job: name of the job.
        threads: physics threads.
        folder: where relative paths of the matrix start; default: here.

    Raises:
        OSError: its log cannot be written, or no process can be started.
    """

    def __init__(self, root: Path, job: str, threads: int, folder: Path | None = None):
        self._bench = BenchDir(root)
        self._job = job
        self._asked = False
        path = self._bench.log_path(job)
        path.parent.mkdir(parents=True, exist_ok=True)
        self._log = path.open("ab")
        words = ["bench", "work", str(root), job, "--threads", str(threads), "--supervised"]
        self._process = start_supervised(words, cwd=folder, stdout=self._log, stderr=self._log)

    def stop(self) -> None:
        """Ask it to stop with a checkpoint; the second time: at once."""
        if self._asked:
            self._process.kill()
        self._asked = True
        self._let_go()

    def wait(self) -> Outcome:
        """Wait for its end and return the outcome; a failure's reason is stored with the benchmark."""
        # not one long wait: Ray cancels a task by an exception between two Python bytecodes
        while self._process.poll() is None:
            time.sleep(_BETWEEN)
        code = self._process.returncode
        if code == 0:
            return "done"
        if code == _INTERRUPTED or self._asked:
            return "interrupted"
        if code < 0:
            name = signal.Signals(-code).name
            hint = ", perhaps for want of memory" if name == "SIGKILL" else ""
            self._bench.note_failure(self._job, f"its process was ended by {name}{hint}")
        elif not self._bench.failure(self._job):
            log = self._bench.log_path(self._job)
            self._bench.note_failure(self._job, f"exit code {code}; see {log}")
        return "failed"

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._let_go()
        self._process.wait()
        self._log.close()

    def _let_go(self) -> None:
        """Close the pipe, which makes the job stop; a signal might be blocked, or come too early."""
        if self._process.stdin is not None:
            self._process.stdin.close()
