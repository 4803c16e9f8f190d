"""Random play for very long: ``PYTHONPATH=tests python tests/envs/soak.py sumo-ants --steps 1000000``."""

from __future__ import annotations

import argparse
import collections
import time
from dataclasses import dataclass, field

import numpy as np

from apil_core.plugins.registry import make_game
from envs.game_laws import Before, check

SCALES = (0.0, 0.3, 1.0, 3.0, 100.0)
"""Of the actions, in units of their bound; every game draws one at its start."""
PAUSED = 0.02
"""Probability that a game is held back in a step."""


@dataclass
class Soaked:
    """What a long run met."""

    name: str
    steps: int = 0
    seconds: float = 0.0
    endings: collections.Counter[str] = field(default_factory=collections.Counter)

    def __str__(self) -> str:
        rate = self.steps / max(self.seconds, 1e-9)
        games = self.endings.total()
        met = ", ".join(f"{cause} {count}" for cause, count in self.endings.most_common())
        return (
            f"{self.name}: {self.steps} steps, {games} games, {self.endings['diverged']} diverged, "
            f"{rate:.0f} steps/s; {met}"
        )


def soak(name: str, steps: int, num_envs: int = 256, seed: int = 0, threads: int = 2) -> Soaked:
    """Play ``steps`` steps in all with random actions, every one checked by the laws of the game."""
    game, rng = make_game(name, num_envs=num_envs, threads=threads), np.random.default_rng(seed)
    game.seed(seed)
    game.reset()
    lengths, result, start = np.zeros(num_envs, int), Soaked(name), time.perf_counter()
    scale = rng.choice(SCALES, num_envs)
    while result.steps < steps:
        active = rng.random(num_envs) >= PAUSED
        first, second = (
            (rng.standard_normal((num_envs, side.action_size)) * scale[:, None] * side.action_high).astype(
                np.float32
            )
            for side in game.layout.sides
        )
        kept = tuple(o.copy() for o in game.observations)
        step = game.step((first, second), active)
        check(name, game, Before(active, lengths, kept), step)
        result.steps += int(active.sum())
        result.endings.update(game.layout.causes[c] for c in step.cause[step.done])
        lengths = np.where(step.done, 0, lengths + active)
        scale[step.done] = rng.choice(SCALES, step.done.sum())
        game.reset(step.done)
    result.seconds = time.perf_counter() - start
    return result


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("game")
    parser.add_argument("--steps", type=int, default=1_000_000)
    parser.add_argument("--num-envs", type=int, default=256)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    print(soak(given.game, given.steps, given.num_envs, given.seed), flush=True)
