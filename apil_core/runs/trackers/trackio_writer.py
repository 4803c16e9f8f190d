"""The process that runs Trackio: reads JSON lines, writes rows to its store.

The first line names project, run, group and config; it is answered by ``{}`` or ``{"error": …}``. Each
further line is a row of metrics, or of final scores. The end of the input is the end of the run.
"""

from __future__ import annotations

import json
import os
import signal
import sqlite3
import sys
import warnings
from collections.abc import Mapping
from contextlib import closing
from typing import Any


class Writer:
    """Writes the rows of one run.

    Args:
        start: ``project``, ``name``, ``group`` and ``config``.

    Raises:
        RuntimeError: the configured server cannot be reached.
        Exception: any error of trackio.
    """

    def __init__(self, start: Mapping[str, Any]):
        import trackio

        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            self._run = trackio.init(**start, resume="allow", embed=False)
        lost = [f"{each.message}" for each in caught if "trackio.init() could not" in f"{each.message}"]
        if lost:
            self._run._stop_flag.set()
            raise RuntimeError(lost[0])
        self._first = True
        self._finish = trackio.finish

    def record(self, row: Mapping[str, Any]) -> None:
        """Log a row; the first one replaces all from its first step on."""
        if "final/steps" in row:
            self._run.log(dict(row), step=int(row["final/steps"]))
            return
        step = int(row["steps"])
        if self._first:
            self._go_back_to(step - int(row.get("row_steps", 1)) + 1)
            self._first = False
        self._run.log(dict(row), step=step)

    def close(self) -> None:
        """Wait until all is stored."""
        self._finish()

    def _go_back_to(self, first: int) -> None:
        """Delete stored rows beyond the checkpoint that the run resumes from."""
        from trackio.sqlite_storage import SQLiteStorage

        path = SQLiteStorage.get_project_db_path(self._run.project)
        if not path.is_file():
            return
        with closing(sqlite3.connect(path, timeout=30)) as database, database:
            database.execute("DELETE FROM metrics WHERE run_id = ? AND step >= ?", (self._run.id, first))


def main() -> None:
    """Write the rows of one run from stdin."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    with os.fdopen(os.dup(1), "w") as answers:
        os.dup2(2, 1)  # trackio prints
        try:
            writer = Writer(json.loads(sys.stdin.readline()))
        except Exception as error:
            text = " ".join(str(error).split()) or type(error).__name__
            answers.write(json.dumps({"error": text}) + "\n")
            return
        answers.write("{}\n")
        answers.flush()
        sys.stdout.flush()
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # a live view may use the terminal from here on
        for line in sys.stdin:
            writer.record(json.loads(line))
        writer.close()


if __name__ == "__main__":
    main()
