"""One game in a prepared state, to see what the rules make of it."""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import strategies as st

from apil_core import GameStep
from apil_core.plugins.registry import make_game
from apil_envs.game_base import MujocoGame

LYING_BACK = [0.7071067811865476, 0, 0.7071067811865476, 0]
"""Turned about y: the head towards +x, the feet towards -x."""
LYING_FRONT = [0.7071067811865476, 0, -0.7071067811865476, 0]
"""The head towards -x, the feet towards +x."""

ON_ITS_BACK = [0, 1, 0, 0]
ANT_LEGS = [0, 1, 0, -1, 0, -1, 0, 1]
"""Hinges of an ant, all within their ranges (rad)."""


def staged(name: str, **options: Any) -> MujocoGame:
    """A game in the scene's pose, without noise and at rest; move the robots, then :func:`play_on`."""
    game = make_game(name, num_envs=1, options=options)
    assert isinstance(game, MujocoGame)
    game.seed(0)
    game.reset()
    game.physics.qpos[:] = game.physics.model.qpos0
    game.physics.qvel[:] = 0
    for robot in game.robots:
        if robot.qpos.shape[1] == 15:
            robot.qpos[:, 7:] = ANT_LEGS
    return game


def put(
    game: MujocoGame, side: int, x: float, z: float | None = None, turn: list[float] | None = None
) -> None:
    """Move the root of a robot to (x, 0, z)."""
    root = game.robots[side].qpos
    root[:, :2] = [x, 0]
    if z is not None:
        root[:, 2] = z
    if turn is not None:
        root[:, 3:7] = turn


def play_on(game: MujocoGame, action: float = 0.0) -> GameStep:
    """One step from the prepared state with the same number for every action."""
    game.physics.forward()
    for side, robot in enumerate(game.robots):
        game._centre_before[side] = robot.centre
    first, second = (np.full((1, side.action_size), action, np.float32) for side in game.layout.sides)
    return game.step((first, second))


def cause(game: MujocoGame, step: GameStep) -> str | None:
    """Name of the ending of the only game."""
    return game.layout.causes[step.cause[0]] if step.done[0] else None


def around(value: float) -> st.SearchStrategy[float]:
    """Numbers near ``value``, often it and its two neighbours."""
    exact = st.sampled_from([value, float(np.nextafter(value, -9)), float(np.nextafter(value, 9))])
    return exact | st.floats(value - 1, value + 1)
