"""Kill trainings at random moments, resume each to its end, and compare it with one left in peace.

    python benchmarks/kills.py --kills 50 --seed 0

SIGKILL comes at moments that are random, drawn from ``--seed``, as shares of the undisturbed training's time.
All that the last checkpoint holds (weights first), the rows of the log and the final score must be equal bit
for bit. The exit code is 1 if something differs, or a command fails.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Sequence
from functools import partial
from importlib import import_module
from itertools import cycle
from pathlib import Path
from typing import Any

from apil_core.training.storage.recorders import read_metrics
from apil_core.training.storage.run_dir import RunDir
from fuzz import IMPORTED_ONCE, forked
from interrupted import TIMINGS, weights

TOY = "--env toy-pursuit --num-envs 16 --steps 12k"
MUJOCO = "--env you-shall-not-pass --victim embedded:you-shall-not-pass/runner/v1 --num-envs 8 --steps 5k"
CASES = [f"--method {method} {TOY}" for method in ("adrl", "apl", "apil", "e_apil")]
CASES += [f"--method {method} {MUJOCO}" for method in ("adrl", "e_apil")]
COMMON = "--threads 1 --quiet --set ppo.num_steps=64 --set checkpoint.every_iterations=2"
SCORES = "--set evaluation.episodes=20 --set evaluation.every_steps=3k --set evaluation.periodic_episodes=10"
MEAN = 0.3
"""Mean time until a kill, as a share of the undisturbed training's."""


def main(words: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0, help="of the moments")
    asked = parser.parse_args(words)
    for module in (*IMPORTED_ONCE, "apil_core.cli.guard", "apil_core.runs.runner"):
        import_module(module)
    root, chance = Path(tempfile.mkdtemp(prefix="apil-kills-")), random.Random(asked.seed)
    whole: dict[int, tuple[float, RunDir]] = {}
    kills = runs = wrong = 0
    for number, case in cycle(enumerate(CASES)):
        if kills >= asked.kills and runs >= len(CASES):
            break
        start = [*f"run {case} {COMMON} {SCORES}".split(), "--out"]
        if number not in whole:
            begin, path = time.monotonic(), root / f"{number}-whole"
            if attempt([*start, str(path)], 600.0, root / "said") != 0:
                return 1
            whole[number] = time.monotonic() - begin, RunDir(path)
        seconds, peaceful = whole[number]
        run, killed = RunDir(root / f"{number}-{runs}"), 0
        code: int | None = None
        while code is None:
            if not run.checkpoints():  # killed before the first: begin again, as the message says
                shutil.rmtree(run.path, ignore_errors=True)
            resume = ["resume", str(run.path), "--quiet"]
            if (run.result() or {}).get("status") == "finished":  # killed after its end
                code = 0
                break
            delay = chance.uniform(0, 2 * MEAN) * seconds
            code = attempt(resume if run.path.is_dir() else [*start, str(run.path)], delay, root / "said")
            killed += code is None
        kills, runs = kills + killed, runs + 1
        different = [what for what, value in facts(run).items() if facts(peaceful)[what] != value]
        wrong += bool(code or different)
        told = (
            f"exit {code}: {(root / 'said').read_text()[-300:]}"
            if code
            else f"different: {', '.join(different) or 'nothing'}"
        )
        print(f"{case}: killed {killed} times, {told}", flush=True)
    print(f"{kills} kills in {runs} runs, {wrong} of them wrong")
    shutil.rmtree(root)
    return min(wrong, 1)


def attempt(words: list[str], seconds: float, said: Path) -> int | None:
    """Exit code of a command in a process of its own, or ``None`` if it was killed after that time."""
    from apil_core.cli.guard import guarded

    said.unlink(missing_ok=True)
    child, end = forked(partial(guarded, words), said), time.monotonic() + seconds
    while time.monotonic() < end:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.002)
    os.killpg(child, signal.SIGKILL)
    status = os.waitpid(child, 0)[1]
    return None if os.WIFSIGNALED(status) else os.waitstatus_to_exitcode(status)


def facts(run: RunDir) -> dict[str, Any]:
    """What must not depend on kills."""
    score = json.loads(run.result_path.read_text())["evaluation"]
    rows = [{k: v for k, v in row.items() if k not in TIMINGS} for row in read_metrics(run.metrics_path)]
    return {
        "checkpoint": weights(run),
        "rows": repr(rows),  # NaN equals NaN
        "score": [score[what] for what in ("episodes", "wins", "ties", "losses")],
    }


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    sys.exit(main())
