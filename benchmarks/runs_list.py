"""Time ``apil runs list`` over many runs: copies of one small real run, each of another seed.

    python benchmarks/runs_list.py [--runs 2000]

Prints seconds and milliseconds a run; the second figure is for runs made before ``config.json`` was
(their YAML is parsed). Page caches are warm; the figures depend on the machine.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path

SMALL = ("--env", "toy-pursuit", "--method", "e_apil", "--steps", "2k", "--num-envs", "16", "--quiet")


def apil(*words: str | Path) -> None:
    """Run the command line in a subprocess; discard its output."""
    command = [sys.executable, "-P", "-m", "apil_core.cli", *map(str, words)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)


def copies(made: Path, root: Path, count: int, *, with_json: bool) -> None:
    """Make ``count`` directories with the small files of the run ``made``, each with its own seed."""
    from apil_core.config.layers import write_copy

    config = (made / "config.yaml").read_text()
    for seed in range(count):
        run = root / f"r{seed:04}"
        run.mkdir(parents=True)
        for name in ("metrics.jsonl", "result.json", "environment.json"):
            (run / name).write_bytes((made / name).read_bytes())
        text = config.replace("\nseed: 0\n", f"\nseed: {seed}\n")
        (run / "config.yaml").write_text(text)
        if with_json:
            write_copy(run / "config.yaml", text)


def main() -> None:
    """Make the runs, list them, print the times."""
    asked = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    asked.add_argument("--runs", type=int, default=2000)
    count = asked.parse_args().runs
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder) / "made"
        apil("run", *SMALL, "--set", "evaluation.episodes=8", "--out", made)
        for with_json in (True, False):
            root = Path(folder) / f"runs-{with_json}"
            copies(made, root, count, with_json=with_json)
            begin = time.perf_counter()
            apil("runs", "list", root, "--json")
            seconds = time.perf_counter() - begin
            kind = "with config.json" if with_json else "without"
            print(f"{count} runs {kind}: {seconds:.1f} s, {1000 * seconds / count:.2f} ms a run")


if __name__ == "__main__":
    main()
