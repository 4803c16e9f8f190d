"""Final metrics of trained imitators: one row a run, from its last five iterations and its final score.

python benchmarks/imitation/table.py RUN... --out docs/results/imitation/runs.json   # reads runs, prints rows
python benchmarks/imitation/table.py docs/results/imitation/runs.json               # prints the rows again
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from apil_core.training.storage.recorders import read_metrics
from apil_core.training.storage.run_dir import RunDir

LAST = 5
HEAD = (
    "| game | method | objective | rollouts | β | error ÷ constant | explained share "
    "| log-likelihood (constant) | D right on victim / imitator | win % |"
)
METRICS = (
    *("relative_error", "explained_share", "log_likelihood", "constant_log_likelihood"),
    *("discriminator_accuracy_victim", "discriminator_accuracy_imitator"),
)


def summary(path: Path) -> dict[str, Any]:
    """Settings that differ, means over the last five iterations, and the final score's win rate."""
    run = RunDir(path)
    config, rows = run.config(), read_metrics(run.metrics_path)[-LAST:]
    apil = config.options["apil"]
    score = (run.result() or {}).get("evaluation") or {}
    return {
        "game": config.env,
        "method": config.method,
        "objective": apil["imitator"]["objective"],
        "rollouts": apil["rollouts"],
        "beta": config.options.get("e_apil", {}).get("beta"),
        "seed": config.seed,
        "steps": rows[-1]["steps"],
        "iterations": rows[-1]["iteration"],
        "win": score.get("win_rate"),
        "episodes": score.get("episodes"),
        **{name: sum(row[f"apil/{name}"] for row in rows) / len(rows) for name in METRICS},
    }


def row(found: dict[str, Any]) -> str:
    """Format one row of the table."""
    win = found["win"]
    won = f"{100 * win['value']:.1f} [{100 * win['low']:.1f}, {100 * win['high']:.1f}]" if win else "–"
    beta = "–" if found["beta"] is None else f"{found['beta']:g}"
    constant = found["constant_log_likelihood"]
    right = "/".join(f"{found[f'discriminator_accuracy_{who}']:.2f}" for who in ("victim", "imitator"))
    cells = (
        *(found["game"], found["method"], found["objective"], found["rollouts"], beta),
        *(f"{found['relative_error']:.2f}", f"{found['explained_share']:.2f}"),
        *(f"{found['log_likelihood']:.1f} ({constant:.1f})", right, won),
    )
    return f"| {' | '.join(cells)} |"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("sources", type=Path, nargs="+", help="run directories, or one JSON file")
    parser.add_argument("--out", type=Path, help="JSON file for the summaries")
    arguments = parser.parse_args()
    first = arguments.sources[0]
    if first.suffix == ".json":
        found = json.loads(first.read_text())
    else:
        found = [summary(path) for path in arguments.sources]
    if arguments.out:
        arguments.out.write_text(json.dumps(found, indent=1) + "\n")
    print("\n".join([HEAD, "|---" * HEAD.count(" |") + "|", *map(row, found)]))


if __name__ == "__main__":
    main()
