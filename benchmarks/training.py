"""How much of a training run is physics: collection and whole training against ``Batch.step`` alone.

Each iteration's physics calls are recorded (state and controls before the call) and replayed right
after it on a second ``Batch`` of the same model and threads, timed alone: the same work, on the same
machine, within seconds. Ratios are therefore meaningful on noisy machines; steps/s are not.

    python benchmarks/training.py --methods adrl e_apil --iterations 5
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from typing import Any

import numpy as np
import torch
from mujoco.batch import Batch

from apil_core import RunConfig
from apil_core.build import build
from apil_core.registry import default_plugins
from apil_core.trainer import Trainer


class Recorder:
    """Keeps what every physics call of a game started from, and replays it on a batch of its own."""

    def __init__(self, game: Any, threads: int):
        self._physics = game.physics
        self._call = game.physics.step
        self._before: list[np.ndarray] = []
        self._batch = Batch(game.physics.model, game.num_envs, threads)
        self._substeps = game.physics._substeps
        game.physics.step = self._step

    def _step(self, active: Any = None) -> Any:
        self._before.append(self._physics.state.copy())
        return self._call(active)

    def replay(self) -> float:
        """Seconds the recorded calls take without anything else; forgets them."""
        seconds = 0.0
        for state in self._before:
            self._batch.state[...] = state
            begin = time.perf_counter()
            self._batch.step(nstep=self._substeps)
            seconds += time.perf_counter() - begin
        self._before = []
        return seconds


def measure(method: str, args: argparse.Namespace) -> dict[str, Any]:
    """Medians over iterations (the first warms up), and quartiles of the ratios."""
    config = RunConfig(
        method=method,
        env=args.env,
        num_envs=args.num_envs,
        threads=args.threads,
        game=json.loads(args.game),
        ppo={"num_steps": args.num_steps},
        steps=10**9,
    )
    attack = build(config, default_plugins())
    trainer = Trainer(attack, default_plugins())
    recorder = Recorder(attack.game, args.threads)
    rows = []
    for i in range(args.iterations + 1):
        metrics = trainer.iterate()
        physics = recorder.replay()
        if i:
            whole = metrics["collect_seconds"] + metrics["update_seconds"]
            rows.append((physics, metrics["collect_seconds"], whole))
    steps = args.num_envs * args.num_steps
    physics, collect, whole = (statistics.median(column) for column in zip(*rows, strict=True))
    return {
        "method": method,
        "physics_steps_per_second": steps / physics,
        "collection_steps_per_second": steps / collect,
        "training_steps_per_second": steps / whole,
        "collection_ratio": _spread([p / c for p, c, _ in rows]),
        "training_ratio": _spread([p / w for p, _, w in rows]),
    }


def _spread(values: list[float]) -> dict[str, float]:
    return {"median": statistics.median(values), "min": min(values), "max": max(values)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--env", default="kick-and-defend")
    parser.add_argument("--methods", nargs="+", default=["adrl", "apl", "apil", "e_apil"])
    parser.add_argument("--num-envs", type=int, default=128)
    parser.add_argument("--num-steps", type=int, default=128)
    parser.add_argument("--threads", type=int, default=0)
    parser.add_argument("--iterations", type=int, default=3)
    parser.add_argument("--game", default="{}", help='game options as JSON, e.g. {"solver": "Newton"}')
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    torch.set_num_threads(1)
    results = [measure(method, args) for method in args.methods]
    if args.json:
        print(json.dumps(results, indent=2))
        return
    for r in results:
        collect, train = r["collection_ratio"], r["training_ratio"]
        print(
            f"{r['method']:8} physics {r['physics_steps_per_second']:6.0f}/s"
            f"  collection {r['collection_steps_per_second']:6.0f}/s"
            f" = {collect['median']:.2f} of it [{collect['min']:.2f}, {collect['max']:.2f}]"
            f"  training {r['training_steps_per_second']:6.0f}/s"
            f" = {train['median']:.2f} [{train['min']:.2f}, {train['max']:.2f}]"
        )


if __name__ == "__main__":
    main()
