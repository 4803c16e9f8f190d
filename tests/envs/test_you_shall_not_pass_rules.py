"""Every ending of you-shall-not-pass: the pure rules against plain Python, and played out."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from apil_core import NO_WINNER
from apil_core.plugins.registry import make_game
from apil_envs.game_base import MujocoGame
from apil_envs.you_shall_not_pass import CAUSES, decide

from . import rule_reference
from .staged import LYING_BACK, LYING_FRONT, around, cause, play_on, put, staged

BLOCKER, RUNNER = 0, 1
LINE, DOWN = -4.0, 0.3


def ruled(x: float, heights: tuple[float, float], late: bool) -> rule_reference.Outcome:
    verdict = decide(np.array([x]), np.array(heights)[:, None], np.array([late]))
    name = CAUSES[verdict.cause[0]] if verdict.cause[0] >= 0 else None
    blocker, runner = verdict.sparse[:, 0]
    return rule_reference.Outcome(name, int(verdict.winner[0]), (blocker, runner))


@given(around(LINE), st.tuples(around(DOWN), around(DOWN)), st.booleans())
def test_decide_is_the_plain_rule_book(x, heights, late) -> None:
    assert ruled(x, heights, late) == rule_reference.you_shall_not_pass(x, heights, late)


@pytest.mark.parametrize(
    ("x", "heights", "late", "ending", "winner", "sparse"),
    [
        (0, (1.4, 1.4), False, None, NO_WINNER, (0, 0)),
        (LINE, (1.4, 1.4), False, None, NO_WINNER, (0, 0)),
        (np.nextafter(LINE, -9), (1.4, 1.4), False, "passed", RUNNER, (-1000, 1000)),
        (-5, (1.4, 0.1), True, "passed", RUNNER, (-1000, 1000)),
        (0, (1.4, DOWN), False, "runner-down", BLOCKER, (1000, -1000)),
        (0, (1.4, np.nextafter(DOWN, 1)), False, None, NO_WINNER, (0, 0)),
        (0, (DOWN, 0.2), False, "runner-down", BLOCKER, (0, -1000)),
        (0, (np.nextafter(DOWN, 1), 0.2), False, "runner-down", BLOCKER, (1000, -1000)),
        (0, (1.4, 0.2), True, "runner-down", BLOCKER, (1000, -1000)),
        (0, (0.1, 1.4), False, None, NO_WINNER, (0, 0)),
        (0, (1.4, 1.4), True, "time-up", BLOCKER, (0, -1000)),
        (0, (0.1, 1.4), True, "time-up", BLOCKER, (0, -1000)),
    ],
)
def test_the_table(x, heights, late, ending, winner, sparse) -> None:
    expected = rule_reference.Outcome(ending, winner, sparse)
    assert ruled(x, heights, late) == expected
    assert rule_reference.you_shall_not_pass(x, heights, late) == expected


def feet_first(game: MujocoGame) -> None:
    """The root is still before the line, the mass centre beyond."""
    put(game, RUNNER, -3.9, 1.5, LYING_BACK)


def head_first(game: MujocoGame) -> None:
    """The root is beyond the line, the mass centre before it."""
    put(game, RUNNER, -4.05, 1.5, LYING_FRONT)


def runner_lies(game: MujocoGame) -> None:
    put(game, RUNNER, 1, 0.2, LYING_BACK)


def blocker_lies(game: MujocoGame) -> None:
    put(game, BLOCKER, -1, 0.2, LYING_BACK)


def runner_beyond_and_down(game: MujocoGame) -> None:
    put(game, RUNNER, -4.5, 0.2, LYING_BACK)


@pytest.mark.parametrize(
    ("prepare", "max_steps", "ending", "winner", "sparse"),
    [
        ([], 500, None, NO_WINNER, (0, 0)),
        ([feet_first], 500, "passed", RUNNER, (-1000, 1000)),
        ([head_first], 500, None, NO_WINNER, (0, 0)),
        ([runner_beyond_and_down], 500, "passed", RUNNER, (-1000, 1000)),
        ([feet_first], 1, "passed", RUNNER, (-1000, 1000)),
        ([runner_lies], 500, "runner-down", BLOCKER, (1000, -1000)),
        ([runner_lies, blocker_lies], 500, "runner-down", BLOCKER, (0, -1000)),
        ([blocker_lies], 500, None, NO_WINNER, (0, 0)),
        ([runner_lies], 1, "runner-down", BLOCKER, (1000, -1000)),
        ([], 1, "time-up", BLOCKER, (0, -1000)),
    ],
)
def test_played_out(
    prepare: list[Callable[[MujocoGame], None]],
    max_steps: int,
    ending: str | None,
    winner: int,
    sparse: tuple[float, float],
) -> None:
    game = staged("you-shall-not-pass", max_steps=max_steps)
    for change in prepare:
        change(game)
    step = play_on(game)
    assert cause(game, step) == ending
    assert step.winner[0] == winner
    np.testing.assert_array_equal(step.sparse[:, 0], sparse)
    way_left = abs(game.robots[RUNNER].qpos[0, 0] - LINE) * (ending != "passed")
    assert step.shaping[BLOCKER, 0] - step.dense[BLOCKER, 0] == pytest.approx(way_left, abs=1e-5)
    assert step.shaping[RUNNER, 0] == step.dense[RUNNER, 0]


def test_dense_rewards_by_hand() -> None:
    """Both upright in mid-air without contacts; the control cost is on the actions as asked for."""
    game = staged("you-shall-not-pass")
    for side, x in ((BLOCKER, -1), (RUNNER, 1)):
        put(game, side, x, 2.0)
    game.robots[RUNNER].qvel[:, 0] = -2.0
    step = play_on(game, action=3.0)
    control = 0.1 * 17 * 3.0**2
    assert step.dense[BLOCKER, 0] == pytest.approx(5 - control, abs=1e-3)
    x = game.robots[RUNNER].qpos[0, 0]
    forward = 0.25 * (2.0 * 0.015) / 0.003
    assert step.dense[RUNNER, 0] == pytest.approx(forward - control + 5 - abs(x + 4), abs=0.05)


def test_start_of_games() -> None:
    game = make_game("you-shall-not-pass", num_envs=400)
    game.seed(5)
    game.reset()
    for side, x in ((BLOCKER, -1), (RUNNER, 1)):
        robot = game.robots[side]
        assert robot.qvel.std() == pytest.approx(0.1, rel=0.05)
        offsets = robot.qpos - game.physics.model.qpos0.reshape(2, 24)[side]
        np.testing.assert_allclose(np.linalg.norm(robot.qpos[:, 3:7], axis=1), 1)
        free = np.delete(offsets, range(3, 7), axis=1)  # the quaternion is normalised afterwards
        assert 0.099 < np.abs(free).max() <= 0.1
        assert free.std() == pytest.approx(0.2 / 12**0.5, rel=0.03)
        np.testing.assert_allclose(robot.qpos[:, 0].mean(), x, atol=0.02)
        np.testing.assert_allclose(robot.qpos[:, 2].mean(), 1.4, atol=0.02)
