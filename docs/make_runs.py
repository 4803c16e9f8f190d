"""Turns run directories, one of each method, into the tables and the picture of a page about them.

    python docs/make_runs.py docs/images/first-runs.png runs/adrl runs/apl runs/apil runs/e_apil > tables.md

Prints Markdown; writes the picture. Scores kept with a run (``apil eval --keep NAME``) are rows of their own.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from apil_core.studies.bench.folder import read_score
from apil_core.studies.curves.groups import read_groups
from apil_core.studies.curves.picture import draw_curves
from apil_core.training.storage.recorders import read_metrics
from apil_core.training.storage.run_dir import RunDir


def read(run: RunDir) -> tuple[list[dict[str, float]], dict[str, Any]]:
    """Metrics, and the result with further ``scores`` in the form of its ``evaluation``."""
    kept = {
        path.stem: read_score(run.path, path.stem) for path in sorted((run.path / "scores").glob("*.json"))
    }
    scores = {name: score.model_dump(mode="json") for name, score in kept.items()}
    return read_metrics(run.metrics_path), {**(run.result() or {}), "scores": scores}


def scored(
    runs: dict[str, tuple[list[dict[str, float]], dict[str, Any]]],
) -> list[tuple[str, dict[str, Any], dict[str, Any]]]:
    """Label, result and score of every row."""
    return [
        (label, result, score)
        for method, (_, result) in runs.items()
        for label, score in [
            (method, result["evaluation"]),
            *((f"{method}, {name}", score) for name, score in result["scores"].items()),
        ]
    ]


def percent(rate: dict[str, float]) -> str:
    return f"{100 * rate['value']:.1f} [{100 * rate['low']:.1f}, {100 * rate['high']:.1f}]"


def evaluation_table(runs: dict[str, tuple[list[dict[str, float]], dict[str, Any]]]) -> None:
    print("| method | steps | win % | win+tie % | loss % | mean length | training time |")
    print("|---|---|---|---|---|---|---|")
    for label, result, score in scored(runs):
        print(
            f"| {label} | {result['steps']:,} | {percent(score['win_rate'])} "
            f"| {percent(score['win_or_tie_rate'])} | {percent(score['loss_rate'])} "
            f"| {score['mean_length']:.0f} | {result['wall_seconds'] / 60:.1f} min |"
        )
    print("\n| method | how the games ended |\n|---|---|")
    for label, _, score in scored(runs):
        causes = sorted(score["causes"].items(), key=lambda item: -item[1])
        print(f"| {label} | {', '.join(f'{name} {count}' for name, count in causes)} |")


def curve_table(runs: dict[str, tuple[list[dict[str, float]], dict[str, Any]]], rows: int = 6) -> None:
    print("\n| steps |", " | ".join(f"{m} win % | {m} win+tie %" for m in runs), "|")
    print("|---" * (1 + 2 * len(runs)) + "|")
    length = len(next(iter(runs.values()))[0])
    for i in sorted({round((k + 1) * length / rows) - 1 for k in range(rows)}):
        cells = []
        for metrics, _ in runs.values():
            m = metrics[i]
            wins, ties, games = (m[f"window_{k}"] for k in ("wins", "ties", "games"))
            cells += [f"{100 * wins / games:.1f}", f"{100 * (wins + ties) / games:.1f}"]
        steps = next(iter(runs.values()))[0][i]["steps"]
        print(f"| {steps:,.0f} |", " | ".join(cells), "|")


def imitator_table(runs: dict[str, tuple[list[dict[str, float]], dict[str, Any]]], rows: int = 6) -> None:
    keys = {
        "log_likelihood": "log-likelihood",
        "constant_log_likelihood": "of a constant",
        "mse": "squared error",
        "constant_mse": "of a constant",
        "discriminator_accuracy_victim": "D right on victim",
        "discriminator_accuracy_imitator": "D right on imitator",
    }
    for method, (metrics, _) in runs.items():
        if "apil/log_likelihood" not in metrics[0]:
            continue
        print(f"\n{method}:\n\n| steps |", " | ".join(keys.values()), "|")
        print("|---" * (1 + len(keys)) + "|")
        for i in sorted({round((k + 1) * len(metrics) / rows) - 1 for k in range(rows)} | {0}):
            print(
                f"| {metrics[i]['steps']:,.0f} |",
                " | ".join(f"{metrics[i][f'apil/{k}']:.2f}" for k in keys),
                "|",
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("picture", type=Path)
    parser.add_argument("runs", nargs="+", type=Path)
    flags = parser.parse_args()
    found = [RunDir(path) for path in flags.runs]
    print_tables(found)
    draw_curves(read_groups(found), flags.picture)


def print_tables(found: list[RunDir]) -> None:
    """All tables of runs, one of each method."""
    runs = {run.config().method: read(run) for run in found}
    evaluation_table(runs)
    curve_table(runs)
    imitator_table(runs)


if __name__ == "__main__":
    main()
