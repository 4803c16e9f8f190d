"""Turns run directories into the tables and the picture of ``docs/first-runs.md``.

    python docs/make_first_runs.py runs/adrl runs/apl runs/apil runs/e_apil > tables.md

Prints Markdown; writes ``docs/images/first-runs.png``. Needs matplotlib (in the ``dev`` extra).
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

from apil_core.evaluation import wilson

HERE = Path(__file__).parent
COLOURS = {"adrl": "#4477AA", "apl": "#228833", "apil": "#CCBB44", "e_apil": "#EE6677"}


def read(path: Path) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    metrics = [json.loads(line) for line in (path / "metrics.jsonl").read_text().splitlines()]
    return metrics, json.loads((path / "result.json").read_text())


def percent(rate: dict[str, float]) -> str:
    return f"{100 * rate['value']:.1f} [{100 * rate['low']:.1f}, {100 * rate['high']:.1f}]"


def evaluation_table(runs: dict[str, tuple[list[dict[str, Any]], dict[str, Any]]]) -> None:
    print("| method | steps | win % | win+tie % | loss % | mean length | training time |")
    print("|---|---|---|---|---|---|---|")
    for method, (_, result) in runs.items():
        score = result["evaluation"]
        print(
            f"| {method} | {result['steps']:,} | {percent(score['win_rate'])} "
            f"| {percent(score['win_or_tie_rate'])} | {percent(score['loss_rate'])} "
            f"| {score['mean_length']:.0f} | {result['wall_seconds'] / 60:.1f} min |"
        )
    print("\n| method | how the games ended |\n|---|---|")
    for method, (_, result) in runs.items():
        causes = sorted(result["evaluation"]["causes"].items(), key=lambda item: -item[1])
        print(f"| {method} | {', '.join(f'{name} {count}' for name, count in causes)} |")


def curve_table(runs: dict[str, tuple[list[dict[str, Any]], dict[str, Any]]], rows: int = 6) -> None:
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
        print(f"| {steps:,} |", " | ".join(cells), "|")


def imitator_table(runs: dict[str, tuple[list[dict[str, Any]], dict[str, Any]]], rows: int = 6) -> None:
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
                f"| {metrics[i]['steps']:,} |",
                " | ".join(f"{metrics[i][f'apil/{k}']:.2f}" for k in keys),
                "|",
            )


def picture(runs: dict[str, tuple[list[dict[str, Any]], dict[str, Any]]], path: Path) -> None:
    figure, axes = plt.subplots(1, 3, figsize=(12, 3.6), layout="constrained")
    for method, (metrics, _) in runs.items():
        metrics = [m for m in metrics if m["window_games"] >= 100]
        steps = [m["steps"] / 1000 for m in metrics]
        games = [m["window_games"] for m in metrics]
        colour = COLOURS.get(method)
        for axis, counts in (
            (axes[0], [m["window_wins"] for m in metrics]),
            (axes[1], [m["window_wins"] + m["window_ties"] for m in metrics]),
        ):
            rates = [wilson(int(c), int(g)) for c, g in zip(counts, games, strict=True)]
            axis.plot(steps, [100 * r.value for r in rates], color=colour, label=method)
            low, high = [100 * r.low for r in rates], [100 * r.high for r in rates]
            axis.fill_between(steps, low, high, color=colour, alpha=0.12, linewidth=0)
        if "apil/mse" in metrics[0]:
            ratio = [m["apil/mse"] / m["apil/constant_mse"] for m in metrics]
            axes[2].plot(steps, ratio, color=colour, label=method)
    axes[2].axhline(1.0, color="black", linewidth=0.8, linestyle=":")
    titles = ("win, last 1000 games (%)", "win + tie (%)", "imitator's squared error / a constant's")
    for axis, title in zip(axes, titles, strict=True):
        axis.set_title(title, fontsize=10)
        axis.set_xlabel("thousand steps")
        axis.spines[["top", "right"]].set_visible(False)
    axes[0].legend(frameon=False)
    path.parent.mkdir(exist_ok=True)
    figure.savefig(path, dpi=110)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("runs", nargs="+", type=Path)
    runs = {path.name: read(path) for path in parser.parse_args().runs}
    evaluation_table(runs)
    curve_table(runs)
    imitator_table(runs)
    picture(runs, HERE / "images" / "first-runs.png")


if __name__ == "__main__":
    main()
