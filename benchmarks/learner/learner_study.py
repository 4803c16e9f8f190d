"""Compare PPO settings by learning speed: the study behind docs/learner.md.

    python benchmarks/learner/learner_study.py run RUNS --variant efficient white --seeds 0 1
    python benchmarks/learner/learner_study.py table RUNS --out docs/results/learner/runs.json
    python benchmarks/learner/learner_study.py table docs/results/learner/runs.json

Runs lie in RUNS/GAME/METHOD-VARIANT-sSEED; finished ones are kept, unfinished ones are resumed. A run
is one process with one thread; --workers run in parallel.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from itertools import product
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML

from apil_core.evaluation.results import wilson
from apil_core.training.storage.recorders import read_metrics

VARIANTS = Path(__file__).with_name("variants.yaml")
OPPONENTS = {"kick-and-defend": 0.313, "you-shall-not-pass": 0.468, "sumo-humans": 0.08, "sumo-ants": 0.40}
"""Win rate of each game's own opponent against the zoo's victim, of 1000 games (docs/fidelity.md)."""
ALONE = ("plain", "only_")
"""Variants that start from the defaults, not from `efficient`."""
MARKS = (0.4e6, 0.8e6, 1.3e6, 2e6, 4e6, 8e6)
HEAD = (
    "| game | method | variant | seed | 0.4 | 0.8 | 1.3 | 2 | 4 | 8 M | above its own opponent at "
    "| final score | KL | spread | passes |"
)


def train(arguments: argparse.Namespace) -> None:
    """Start or resume every requested run."""
    variants = YAML(typ="safe").load(VARIANTS)
    jobs = product(arguments.seeds, arguments.env, arguments.method, arguments.variant)

    def one(job: tuple[int, str, str, str]) -> None:
        seed, env, method, variant = job
        out = arguments.runs / env / f"{method}-{variant}-s{seed}"
        apil = [sys.executable, "-m", "apil_core.cli"]
        if any(out.glob("checkpoints/iteration-*.pt")):
            command = [*apil, "resume", str(out), "--threads", "1", "--quiet", "--steps", arguments.steps]
        else:
            shutil.rmtree(out, ignore_errors=True)  # killed before its first checkpoint
            base = {} if variant.startswith(ALONE) else variants["efficient"]
            settings = {**base, **variants[variant]}
            sets = [f"--set={key}={json.dumps(value)}" for key, value in settings.items()]
            command = [*apil, "run", "--method", method, "--env", env, "--seed", str(seed)]
            command += ["--steps", arguments.steps, "--physics", "fast", "--threads", "1", "--quiet"]
            command += ["--out", str(out), *sets, *(f"--set={text}" for text in arguments.set)]
        done = subprocess.run(command, check=False, capture_output=True, text=True)
        last = (done.stderr.strip().splitlines() or [""])[-1]
        print(out.relative_to(arguments.runs), "done" if done.returncode == 0 else last, flush=True)

    with ThreadPoolExecutor(arguments.workers) as pool:
        list(pool.map(one, jobs))


def summary(path: Path) -> dict[str, Any] | None:
    """Summarise a run; ``None`` before its first thousand games."""
    rows = [row for row in read_metrics(path / "metrics.jsonl") if row["window_games"] >= 1000]
    if not rows:
        return None
    method, variant, seed = path.name.split("-", 1)[0], *path.name.split("-", 1)[1].rsplit("-s", 1)
    end = rows[-1]["steps"]
    wins = {f"{mark:.0f}": _wins(rows, mark) for mark in MARKS if end >= 0.98 * mark}
    level = OPPONENTS[path.parent.name]
    above = (r["steps"] for r in rows if wilson(int(r["window_wins"]), int(r["window_games"])).low > level)
    score = _score(path / "result.json", "evaluation") or _score(path / "scores" / "plain.json") or {}
    late = rows[-5:]
    return {
        **{"game": path.parent.name, "method": method, "variant": variant, "seed": int(seed), "steps": end},
        **{"wins": wins, "above": next(above, None), "score": score.get("win_rate")},
        "score_with_ties": score.get("win_or_tie_rate"),
        "episodes": score.get("episodes"),
        **{k: sum(row[f"ppo/{k}"] for row in late) / len(late) for k in ("kl", "std", "passes")},
    }


def _score(file: Path, key: str = "") -> Any:
    """The score in a run's result, or in a file of the benchmark."""
    found = json.loads(file.read_text()) if file.is_file() else {}
    return found.get(key) if key else found


def _wins(rows: list[dict[str, float]], steps: float) -> float:
    """Share of the last thousand training games that were won, at that number of steps."""
    before = [row for row in rows if row["steps"] <= 1.01 * steps] or rows[:1]
    return before[-1]["window_wins"] / before[-1]["window_games"]


def row(found: dict[str, Any]) -> str:
    """Format one row of the table."""
    wins = [f"{100 * found['wins'][f'{m:.0f}']:.0f}" if f"{m:.0f}" in found["wins"] else "" for m in MARKS]
    above = "" if found["above"] is None else f"{found['above'] / 1e6:.2f} M"
    score = found["score"]
    interval = (
        f"{100 * score['value']:.1f} [{100 * score['low']:.0f}, {100 * score['high']:.0f}]" if score else ""
    )
    numbers = f"{found['kl']:.3f}", f"{found['std']:.2f}", f"{found['passes']:.0f}"
    names = found["game"], found["method"], found["variant"], str(found["seed"])
    return f"| {' | '.join((*names, *wins, above, interval, *numbers))} |"


def merged(earlier: list[dict[str, Any]], found: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Rows of both, in order; of one run measured twice, the longer."""
    rows: dict[tuple[Any, ...], dict[str, Any]] = {}
    for each in sorted([*earlier, *found], key=lambda row: row["steps"]):
        rows[tuple(each[name] for name in ("game", "method", "variant", "seed"))] = each
    return [rows[key] for key in sorted(rows)]


def table(arguments: argparse.Namespace) -> None:
    """Print the rows, and save them beside those of earlier runs if requested."""
    if arguments.source.suffix == ".json":
        found = json.loads(arguments.source.read_text())
    else:
        paths = sorted(path.parent for path in arguments.source.glob("*/*/metrics.jsonl"))
        found = [made for path in paths if (made := summary(path)) is not None]
    if arguments.out:
        earlier = json.loads(arguments.out.read_text()) if arguments.out.is_file() else []
        found = merged(earlier, found)
        arguments.out.parent.mkdir(parents=True, exist_ok=True)
        arguments.out.write_text(json.dumps(found, indent=1) + "\n")
    print("\n".join([HEAD, "|---" * HEAD.count(" |") + "|", *map(row, found)]))


def main() -> None:
    formatter = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=formatter)
    verbs = parser.add_subparsers(required=True)
    runs = verbs.add_parser("run", help="train")
    runs.add_argument("runs", type=Path)
    runs.add_argument("--env", nargs="+", default=["kick-and-defend", "you-shall-not-pass"])
    runs.add_argument("--method", nargs="+", default=["adrl"])
    runs.add_argument("--variant", nargs="+", default=["efficient"], help="names in variants.yaml")
    runs.add_argument("--seeds", nargs="+", type=int, default=[0])
    runs.add_argument("--steps", default="2M")
    runs.add_argument("--set", action="append", default=[], help="further settings of all runs")
    runs.add_argument("--workers", type=int, default=2)
    runs.set_defaults(do=train)
    rows = verbs.add_parser("table", help="print what runs came to")
    rows.add_argument("source", type=Path, help="directory of runs, or what --out wrote")
    rows.add_argument("--out", type=Path, help="save the rows, beside those of earlier runs in that file")
    rows.set_defaults(do=table)
    arguments = parser.parse_args()
    arguments.do(arguments)


if __name__ == "__main__":
    main()
