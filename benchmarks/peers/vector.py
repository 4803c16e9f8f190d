"""Stable-Baselines3's PPO on our vector environment beside our PPO: speed in turns, and learning curves.

    python benchmarks/peers/vector.py --json docs/results/vector.json --picture docs/images/vector.png

Both train with the same settings against the same victim in one process, on one thread. Times are the
processor's, which other programs on the machine disturb less. See README.md beside this file.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from matplotlib.figure import Figure
from ours import Ours
from sb3_peer import StableBaselines
from stable_baselines3.common.callbacks import BaseCallback
from task import Task, victim_of

from apil_core.common.charts import pens, write_picture
from apil_core.common.statistics import mean_interval
from apil_core.training.storage.environment import environment

SPEED = (("kick-and-defend", "faithful"), ("kick-and-defend", "fast"), ("toy-pursuit", None))
"""Games and their physics."""

Point = tuple[int, float, float]
"""Steps, processor seconds of training, share of the last 1000 training games won."""


class Clock(BaseCallback):
    """Seconds of Stable-Baselines3's collection."""

    def _on_rollout_start(self) -> None:
        self._begin = time.process_time()

    def _on_rollout_end(self) -> None:
        self.collected = time.process_time() - self._begin

    def _on_step(self) -> bool:
        return True


class Theirs(StableBaselines):
    """All games as one ``VecEnv``; iterations are timed."""

    def __init__(self, task: Task):
        super().__init__(task, f"batch:{task.num_envs}", torch_threads=1)
        self.clock = Clock()

    def timed(self) -> tuple[float, float]:
        """Seconds of one iteration's collection, and of all of it."""
        begin = time.process_time()
        self._model.learn(self._batch, callback=self.clock, reset_num_timesteps=False)
        return self.clock.collected, time.process_time() - begin

    def wins(self) -> float:
        """Share of the last 1000 games."""
        return float(np.mean(self._model.ep_success_buffer)) if self._model.ep_success_buffer else 0.0


class Timed(Ours):
    """Our ADRL, which is plain PPO; iterations are timed."""

    def __init__(self, task: Task):
        super().__init__(task, "adrl")
        self._collect, self._trainer._collect = self._trainer._collect, self._clocked

    def timed(self) -> tuple[float, float]:
        """Seconds of one iteration's collection, and of all of it."""
        begin = time.process_time()
        self._metrics = self._trainer.iterate()
        return self.collected, time.process_time() - begin

    def _clocked(self) -> None:
        begin = time.process_time()
        self._collect()
        self.collected = time.process_time() - begin

    def wins(self) -> float:
        """Share of the last 1000 games."""
        return self._metrics["window_wins"] / max(self._metrics["window_games"], 1)


@dataclass(frozen=True)
class Speed:
    """Steps per processor second of both by round, and the mean ratio of a round with a 95 % interval."""

    env: str
    physics: str | None
    what: str
    ours: list[float]
    theirs: list[float]
    ratio: float
    low: float
    high: float

    @classmethod
    def of(cls, task: Task, what: str, ours: list[float], theirs: list[float]) -> Speed:
        """Divide round by round."""
        ratios = np.array(theirs) / np.array(ours)
        return cls(
            *(task.env, task.options.get("physics"), what, ours, theirs),
            *(float(ratios.mean()), *mean_interval(ratios)),
        )


def speed(task: Task, rounds: int) -> list[Speed]:
    """Iterations in turns, the order reversed every round; the first ones warm up."""
    both = Timed(task), Theirs(task)
    seconds: list[list[tuple[float, float]]] = [[one.timed()][1:] for one in both]
    for turn in range(rounds):
        for i in (0, 1) if turn % 2 == 0 else (1, 0):
            seconds[i].append(both[i].timed())
    for one in both:
        one.close()
    rates = [[[task.batch / pair[k] for pair in pairs] for pairs in seconds] for k in (0, 1)]
    return [Speed.of(task, what, *rates[k]) for k, what in enumerate(("collection", "training"))]


def curve(one: Timed | Theirs, steps: int, batch: int) -> list[Point]:
    """Train for that many steps."""
    points: list[Point] = []
    spent = 0.0
    for played in range(batch, steps + 1, batch):
        spent += one.timed()[1]
        points.append((played, spent, one.wins()))
    one.close()
    return points


def curves(env: str, seeds: int, steps: int) -> dict[str, list[list[Point]]]:
    """Learning curves of both, one per seed, seeds in turns."""
    found: dict[str, list[list[Point]]] = {"APIL, ADRL": [], "Stable-Baselines3": []}
    for seed in range(seeds):
        task = Task(env, {}, victim_of(env), batch=2048, num_envs=64, threads=1, seed=seed)
        for name, kind in zip(found, (Timed, Theirs), strict=True):
            found[name].append(curve(kind(task), steps, task.batch))
            steps_done, spent, wins = found[name][-1][-1]
            print(
                f"{env}, seed {seed}, {name}: {wins:.1%} after {steps_done} steps, {spent:.1f} s", flush=True
            )
    return found


def drawn(env: str, found: dict[str, list[list[Point]]]) -> Figure:
    """Means over seeds, and all seeds, over steps and over seconds."""
    figure = Figure(figsize=(9, 3.4), layout="constrained")
    for column, axis in enumerate(figure.subplots(1, 2, sharey=True)):
        for (name, runs), pen in zip(found.items(), pens(len(found)), strict=True):
            all_runs = np.array(runs)[:, 1:]  # (seeds, iterations, 3); in the first only short games ended
            for run in all_runs:
                axis.plot(run[:, column], run[:, 2] * 100, color=pen.colour, alpha=0.3, linewidth=0.8)
            mean = all_runs.mean(0)
            axis.plot(mean[:, column], mean[:, 2] * 100, color=pen.colour, linewidth=2, label=name)
        axis.set_xlabel(("environment steps", "processor seconds, one thread")[column])
        axis.set_ylim(0, 100)
    figure.axes[0].set_ylabel("% of the last 1000 games won")
    figure.axes[0].legend(loc="upper left")
    figure.suptitle(
        f"PPO in {env}: mean of {len(next(iter(found.values())))} seeds, and each", x=0.01, ha="left"
    )
    return figure


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("--rounds", type=int, default=10, help="iterations of each for the speed; 0: no speed")
    add("--num-envs", type=int, default=128, help="games at once, for the speed")
    add("--num-steps", type=int, default=32, help="steps per game and iteration, for the speed")
    add(
        "--speed",
        nargs="*",
        default=[f"{env}:{physics or ''}" for env, physics in SPEED],
        metavar="GAME:PHYSICS",
    )
    add("--curve", default="toy-pursuit", help="game of the learning curves")
    add("--seeds", type=int, default=5, help="of the learning curves; 0: none")
    add("--steps", type=int, default=100_000, help="of each learning curve")
    add("--json", type=Path, metavar="FILE", help="write all numbers there")
    add("--picture", type=Path, metavar="FILE", help="draw the learning curves there")
    options = parser.parse_args(arguments)
    torch.set_num_threads(1)
    rows: list[Speed] = []
    for env, _, physics in (text.partition(":") for text in options.speed if options.rounds):
        settings: dict[str, Any] = {"physics": physics} if physics else {}
        batch = options.num_envs * options.num_steps
        rows += speed(Task(env, settings, victim_of(env), batch, options.num_envs, threads=1), options.rounds)
        for row in rows[-2:]:
            rates = f"ours {np.median(row.ours):.0f}, theirs {np.median(row.theirs):.0f} steps/s"
            ratio = f"{row.ratio:.3f} [{row.low:.3f}, {row.high:.3f}]"
            print(f"{env} {physics} {row.what}: {rates}, theirs ÷ ours {ratio}", flush=True)
    found = curves(options.curve, options.seeds, options.steps) if options.seeds else {}
    if options.json:
        report = {
            "environment": environment(sys.argv),
            "speed": [asdict(row) for row in rows],
            "curves": {"env": options.curve, "runs": found},
        }
        options.json.write_text(json.dumps(report) + "\n")
    if options.picture and found:
        write_picture(options.picture, lambda: drawn(options.curve, found))


if __name__ == "__main__":
    main()
