"""Metrics for Trackio, stored in an SQLite file in the run directory."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from secrets import token_hex
from typing import Any

from apil_core.common.errors import ApilError
from apil_core.common.extras import need
from apil_core.runs.trackers.tracked import PROJECT, TrackedRun, one_line

FINISH_SECONDS = 60.0
"""Seconds that the end of a run waits for rows not stored yet."""

_HINT = "without TRACKIO_SPACE_ID and TRACKIO_SERVER_URL it records locally"


class TrackioRecorder:
    """A tracked run in ``<run_dir>/trackio``, or in ``TRACKIO_DIR``; its name in ``trackio.json``.

    The library fixes its directory when it is imported, and a process may train several runs, so it works
    in a process of its own (:mod:`.trackio_writer`). It outlives a killed run just
    long enough to store all rows it received. Steps are environment steps. A resumed run keeps its name, and
    rows later than its checkpoint are deleted; on a remote server they cannot be deleted and remain.

    Args:
        run_dir: a run directory.

    Raises:
        ApilError: trackio is missing, or cannot write to the configured directory or server.
    """

    name = "trackio"
    dispensable = True

    def __init__(self, run_dir: Path):
        check()
        tracked = TrackedRun.of(run_dir)
        where = tracked.where(self.name)
        # trackio resumes by name only, and many run directories are named s0
        where = where or {"project": PROJECT, "name": f"{tracked.name}-{token_hex(3)}"}
        directory = str(run_dir.resolve() / "trackio")
        self._writer = subprocess.Popen(
            [sys.executable, "-P", "-m", "apil_core.runs.trackers.trackio_writer"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env={"TRACKIO_DIR": directory, **os.environ},
            text=True,
            start_new_session=True,  # Ctrl-C is for the run
        )
        with one_line(self.name, _HINT):
            self._tell({**where, "group": tracked.group, "config": tracked.config})
            self._hear()
        tracked.note_where(self.name, where)

    def record(self, metrics: Mapping[str, float]) -> None:
        """Log one row at ``metrics["steps"]``."""
        self._tell(dict(metrics))

    def summarize(self, scores: Mapping[str, float]) -> None:
        """Log the final scores at the last row's steps: Trackio has no summary."""
        self._tell(dict(scores))

    def close(self) -> None:
        """Wait until all is stored; may be called twice.

        Raises:
            ApilError: it takes too long, or not all could be stored.
        """
        if self._writer.poll() is not None and self._writer.stdin is None:
            return
        try:
            self._writer.communicate(timeout=FINISH_SECONDS)
        except subprocess.TimeoutExpired:
            self._writer.kill()
            self._writer.communicate()
        self._writer.stdin = None
        if self._writer.returncode:
            raise ApilError(f"its process ended with {self._writer.returncode}: the last rows may be missing")

    def _tell(self, message: dict[str, Any]) -> None:
        assert self._writer.stdin is not None
        self._writer.stdin.write(json.dumps(message) + "\n")
        self._writer.stdin.flush()

    def _hear(self) -> None:
        """Wait until the writer is ready."""
        assert self._writer.stdout is not None
        answer = json.loads(self._writer.stdout.readline() or '{"error": "its process ended"}')
        if "error" in answer:
            self._writer.communicate()
            raise RuntimeError(answer["error"])


def check() -> None:
    """Check that Trackio is usable, before anything is built.

    Raises:
        ApilError: trackio is not installed.
    """
    if find_spec("trackio") is None:  # not imported here: it starts a server
        need("trackio")
