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
from collections.abc import Iterable, Mapping
from contextlib import closing
from typing import Any


def begin(start: Mapping[str, Any]) -> Any:
    """Begin or continue a run; returns trackio's.

    Args:
        start: ``project``, ``name``, ``group`` and ``config``.

    Raises:
        RuntimeError: the configured server cannot be reached.
        Exception: any error of trackio.
    """
    import trackio

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        run = trackio.init(**start, resume="allow", embed=False)
    lost = [f"{each.message}" for each in caught if "trackio.init() could not" in f"{each.message}"]
    if lost:
        run._stop_flag.set()
        raise RuntimeError(lost[0])
    return run


def write(run: Any, rows: Iterable[str]) -> None:
    """Log rows of JSON at their steps; the first one replaces all from its first step on."""
    import trackio

    first = True
    for row in map(json.loads, rows):
        final = "final/steps" in row
        step = int(row["final/steps" if final else "steps"])
        if first and not final:
            go_back(run, step - int(row.get("row_steps", 1)) + 1)
            first = False
        run.log(row, step=step)
    trackio.finish()  # waits until all is stored


def go_back(run: Any, first: int) -> None:
    """Delete stored rows beyond the checkpoint that the run resumes from."""
    from trackio.sqlite_storage import SQLiteStorage

    path = SQLiteStorage.get_project_db_path(run.project)
    if path.is_file():
        with closing(sqlite3.connect(path, timeout=30)) as database, database:
            database.execute("DELETE FROM metrics WHERE run_id = ? AND step >= ?", (run.id, first))


def main() -> None:
    """Write the rows of one run from stdin."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    with os.fdopen(os.dup(1), "w") as answers:
        os.dup2(2, 1)  # trackio prints
        try:
            run = begin(json.loads(sys.stdin.readline()))
        except Exception as error:
            text = " ".join(str(error).split()) or type(error).__name__
            answers.write(json.dumps({"error": text}) + "\n")
            return
        answers.write("{}\n")
        answers.flush()
        sys.stdout.flush()
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # a live view may use the terminal from here on
        write(run, sys.stdin)


if __name__ == "__main__":
    main()
