"""What rules and observations cost on top of the physics: pure ``Batch.step`` against ``game.step``.

Both run in turn, in short blocks, from the same states with the same actions, so that a busy machine
slows both alike:

    python benchmarks/physics.py --env sumo-ants --envs 128 --threads 2 --seconds 20
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from mujoco.batch import Batch

from apil_core import make_game
from apil_envs.game_base import MujocoGame

BLOCK = 4
"""Control steps per block; few, since both sides start every block from the same state."""


@dataclass
class Clock:
    """Seconds and environment steps of one contestant."""

    seconds: float = 0.0
    steps: int = 0

    @property
    def rate(self) -> float:
        return self.steps / self.seconds


def warmed_up(env: str, envs: int, threads: int, options: dict[str, Any], steps: int = 40) -> MujocoGame:
    """A game in which the robots have come down and touch the floor, as in play."""
    game = make_game(env, num_envs=envs, threads=threads, options=options)
    assert isinstance(game, MujocoGame), f"{env} is no MuJoCo game"
    game.seed(0)
    game.reset()
    rng = np.random.default_rng(0)
    for _ in range(steps):
        step = game.step(actions(rng, game))
        game.reset(step.done)
    return game


def actions(rng: np.random.Generator, game: MujocoGame) -> tuple[np.ndarray, np.ndarray]:
    side = game.layout.sides[0]
    shape = (2, game.num_envs, side.action_size)
    first, second = rng.normal(0, side.action_high, shape).astype(np.float32)
    return first, second


def time_physics(
    batch: Batch, batches: list[tuple[np.ndarray, np.ndarray]], game: MujocoGame, clock: Clock
) -> None:
    for pair in batches:
        batch.ctrl[:] = np.clip(np.concatenate(pair, axis=1), *game.robots[0].bounds)
        start = time.perf_counter()
        batch.step(nstep=game.options.substeps)
        clock.seconds += time.perf_counter() - start
        clock.steps += batch.nsim


def time_game(
    game: MujocoGame, batches: list[tuple[np.ndarray, np.ndarray]], clock: Clock, ended: np.ndarray
) -> None:
    for pair in batches:
        start = time.perf_counter()
        step = game.step(pair)
        clock.seconds += time.perf_counter() - start
        clock.steps += game.num_envs - int(ended.sum())  # ended games stand still until the block is over
        ended |= step.done


def compare(game: MujocoGame, threads: int, seconds: float) -> tuple[Clock, Clock]:
    """Alternate until the time is up; returns the clocks of physics and game."""
    envs = game.num_envs
    batch = Batch(game.physics.model, envs, threads)
    for name in ("cinert", "cvel", "qfrc_actuator", "cfrc_ext", "subtree_com", "sensordata"):
        batch.bind(name)  # copying derived fields out is the physics' own work
    rng = np.random.default_rng(1)
    pure, whole = Clock(), Clock()
    while pure.seconds + whole.seconds < seconds:
        batches = [actions(rng, game) for _ in range(BLOCK)]
        batch.state[:] = game.physics.state
        rings = game.physics._batch.expanded("geom_size")
        if rings is not None:
            batch.expand("geom_size")[:] = rings
        time_physics(batch, batches, game, pure)
        ended = np.zeros(envs, bool)
        time_game(game, batches, whole, ended)
        game.reset(ended)
    return pure, whole


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--env", default="kick-and-defend")
    parser.add_argument("--envs", type=int, default=128)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--seconds", type=float, default=20)
    parser.add_argument("--fast", action="store_true", help="Euler and Newton instead of RK4 and PGS")
    arguments = parser.parse_args()
    fast = {"integrator": "Euler", "solver": "Newton"} if arguments.fast else {}
    game = warmed_up(arguments.env, arguments.envs, arguments.threads, fast)
    pure, whole = compare(game, arguments.threads, arguments.seconds)
    print(f"{arguments.env}, {arguments.envs} games, {arguments.threads} threads")
    print(f"{game.options.integrator}, {game.options.solver}")
    print(f"physics only   {pure.rate:9.0f} env steps/s")
    print(f"game.step      {whole.rate:9.0f} env steps/s")
    print(f"rules and observations add {100 * (pure.rate / whole.rate - 1):.1f} % to the physics")


if __name__ == "__main__":
    main()
