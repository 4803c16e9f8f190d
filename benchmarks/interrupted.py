"""Compare a benchmark that is interrupted repeatedly at random with an uninterrupted one.

    python benchmarks/interrupted.py smoke --out /tmp/interrupted --seed 0

``apil bench run`` gets SIGINT or SIGKILL at random moments and is started again each time. In the end it
must have the same cells, log rows, scores and weights as an undisturbed run. The directories are kept. The
exit code is 1 if something differs.
"""

from __future__ import annotations

import argparse
import json
import random
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from apil_core.common.errors import ApilError, RunDirError
from apil_core.studies.bench.folder import BenchDir
from apil_core.training.storage.recorders import read_metrics

TIMINGS = {"wall_seconds", "steps_per_second", "collect_seconds", "update_seconds", "memory_mb"}
"""Metrics in which two identical runs differ."""

SIGNALS = (signal.SIGINT, signal.SIGKILL)


def main(words: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("matrix", help="file or name of a matrix; a small one: it is run twice")
    parser.add_argument("--out", type=Path, required=True, help="directory, not there yet")
    parser.add_argument("--times", type=int, default=3, help="interruptions")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0, help="of moments and signals")
    asked = parser.parse_args(words)
    if asked.out.exists():
        parser.error(f"{asked.out} exists")
    peaceful, disturbed = asked.out / "peaceful", asked.out / "disturbed"

    begin = time.monotonic()
    if (code := _start(asked.matrix, peaceful, asked.workers).wait()) != 0:
        return code
    whole = time.monotonic() - begin
    print(f"undisturbed: {whole:.0f} s", flush=True)

    chance = random.Random(asked.seed)
    total = _rows(BenchDir(peaceful))
    for number in range(1, asked.times + 1):
        # chosen by rows, not by time: after the present ones and never after the end
        done = _rows(BenchDir(disturbed))
        moment = chance.randint(done + 1, max(done + 1, total * number // (asked.times + 1)))
        _disturb(asked.matrix, disturbed, asked.workers, moment, total, chance.choice(SIGNALS))
    if (code := _start(asked.matrix, disturbed, asked.workers).wait()) != 0:
        return code
    return _compare(BenchDir(peaceful), BenchDir(disturbed))


def _start(matrix: str, out: Path, workers: int) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "apil_core.cli", "bench", "run", matrix, "--out", str(out)]
    return subprocess.Popen([*command, "--workers", str(workers), "--quiet"], stdout=subprocess.DEVNULL)


def _disturb(matrix: str, out: Path, workers: int, moment: int, total: int, blow: signal.Signals) -> None:
    """Start or resume, and stop it once all logs together have that many rows."""
    scheduler = _start(matrix, out, workers)
    while scheduler.poll() is None and _rows(BenchDir(out)) < moment:
        time.sleep(0.05)
    if scheduler.poll() is not None:
        print("ended before it could be disturbed", flush=True)
        return
    scheduler.send_signal(blow)
    code = scheduler.wait()
    bench = BenchDir(out)
    states = Counter(cell.status for cell in bench.cells())
    told = ", ".join(f"{count} {state}" for state, count in sorted(states.items()))
    print(f"{blow.name} at {_rows(bench)} of {total} iterations: exit code {code}; {told}", flush=True)


def _rows(bench: BenchDir) -> int:
    """Number of rows in the logs of all cells together."""
    return sum(path.read_text().count("\n") for path in bench.path.glob("cells/*/*/*/metrics.jsonl"))


def _compare(one: BenchDir, other: BenchDir) -> int:
    """Print how two benchmarks differ; return 1 if they do, else 0."""
    cells = {cell.name: cell for cell in one.cells()}
    same_cells = [cell.name for cell in other.cells()] == list(cells)
    print(f"cells: {len(cells)}, {'the same' if same_cells else 'NOT the same'}")
    wrong = 0 if same_cells else 1
    for name in cells:
        expected, found = _learnt(one, name), _learnt(other, name)
        iterations = [row["iteration"] for row in found["rows"]]
        once = iterations == sorted(set(iterations))
        different = [what for what in ("rows", "scores", "weights") if found[what] != expected[what]]
        print(
            f"  {name}: {len(iterations)} iterations in {found['sessions']} sessions, "
            f"{'each once' if once else 'SOME TWICE'}; {len(found['scores'])} scores; "
            f"different: {', '.join(different) or 'nothing'}"
        )
        wrong += not once or bool(different)
    print("the same benchmark" if not wrong else f"NOT the same benchmark: {wrong} differences")
    return min(wrong, 1)


def _learnt(bench: BenchDir, name: str) -> dict[str, Any]:
    """Result of a cell, without timings."""
    run = bench.cell(name)
    rows = [{k: v for k, v in row.items() if k not in TIMINGS} for row in read_metrics(run.metrics_path)]
    scores = {}
    for path in sorted((run.path / "scores").glob("*.json")):
        score = json.loads(path.read_text())
        scores[path.stem] = [score[what] for what in ("episodes", "wins", "ties", "losses")]
    sessions = len(json.loads(run.environment_path.read_text()))
    return {"rows": rows, "scores": scores, "sessions": sessions, "weights": weights(run)}


def weights(run: Any) -> dict[str, Any]:
    """All numbers of the last checkpoint, without times, in a form that can be compared."""
    from apil_core.training.storage import checkpoint

    if not run.checkpoints():
        raise RunDirError(f"{run.path} has no checkpoint")
    return dict(_leaves(checkpoint.read(run.newest_checkpoint())))


def _leaves(value: Any, path: str = "") -> Any:
    if isinstance(value, dict):
        for key, item in value.items():
            if key not in TIMINGS and key != "config":
                yield from _leaves(item, f"{path}/{key}")
    elif isinstance(value, list | tuple):
        for number, item in enumerate(value):
            yield from _leaves(item, f"{path}/{number}")
    else:
        yield path, value.numpy().tobytes() if hasattr(value, "numpy") else value


if __name__ == "__main__":
    try:
        sys.exit(main())
    except ApilError as error:
        sys.exit(f"interrupted: {error}")
