"""Every ending of run-to-goal, humans and ants: the pure rules against plain Python, and played out."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from apil_core import NO_WINNER
from apil_core.plugins.registry import make_game
from apil_envs.game_base import MujocoGame
from apil_envs.run_to_goal import CAUSES, decide

from . import rule_reference
from .staged import LYING_BACK, LYING_FRONT, ON_ITS_BACK, around, cause, play_on, put, staged

LOW = {"run-to-goal-humans": 0.8, "run-to-goal-ants": 0.28}
BOTH_GAMES = pytest.mark.parametrize("name", list(LOW))
WON, LOST = (1000, -1000), (-1000, 1000)


def ruled(
    positions: tuple[float, float], heights: tuple[float, float], low: float, late: bool
) -> rule_reference.Outcome:
    down = np.array(heights)[:, None] < low
    verdict = decide(np.array(positions)[:, None], down, np.array([late]))
    name = CAUSES[verdict.cause[0]] if verdict.cause[0] >= 0 else None
    first, second = verdict.sparse[:, 0]
    return rule_reference.Outcome(name, int(verdict.winner[0]), (first, second))


@given(
    st.tuples(around(4), around(-4)),
    st.sampled_from(list(LOW.values())).flatmap(lambda v: st.tuples(st.just(v), around(v), around(v))),
    st.booleans(),
)
def test_decide_is_the_plain_rule_book(positions, low_and_heights, late) -> None:
    low, *heights = low_and_heights
    args = positions, tuple(heights), low, late
    assert ruled(*args) == rule_reference.run_to_goal(*args)


@pytest.mark.parametrize(
    ("positions", "heights", "late", "ending", "winner", "sparse"),
    [
        ((0, 0), (1, 1), False, None, NO_WINNER, (0, 0)),
        ((4, -4), (1, 1), False, None, NO_WINNER, (0, 0)),
        ((-5, 5), (1, 1), False, None, NO_WINNER, (0, 0)),
        ((np.nextafter(4, 9), -4), (1, 1), False, "runner_0-arrived", 0, WON),
        ((4, np.nextafter(-4, -9)), (1, 1), False, "runner_1-arrived", 1, LOST),
        ((4.1, -4.1), (0.1, 0.1), True, "both-arrived", NO_WINNER, (0, 0)),
        ((4.1, 0), (0.1, 0.1), True, "runner_0-arrived", 0, WON),
        ((0, 0), (0.79, 0.79), True, "both-down", NO_WINNER, (0, 0)),
        ((0, 0), (0.8, 0.79), False, None, NO_WINNER, (0, 0)),
        ((0, 0), (1, 1), True, "time-up", NO_WINNER, (0, 0)),
    ],
)
def test_the_table(positions, heights, late, ending, winner, sparse) -> None:
    expected = rule_reference.Outcome(ending, winner, sparse)
    assert ruled(positions, heights, 0.8, late) == expected
    assert rule_reference.run_to_goal(positions, heights, 0.8, late) == expected


Change = Callable[[MujocoGame], None]


def at(side: int, x: float) -> Change:
    return lambda game: put(game, side, x)


def down(side: int) -> Change:
    humans = (0.5, LYING_BACK)
    ants = (0.27, ON_ITS_BACK)

    def change(game: MujocoGame) -> None:
        put(game, side, 2 * side - 1, *(ants if "ants" in str(game.scene) else humans))

    return change


@BOTH_GAMES
@pytest.mark.parametrize(
    ("prepare", "max_steps", "ending", "winner", "sparse"),
    [
        ([], 500, None, NO_WINNER, (0, 0)),
        ([at(0, 4.1)], 500, "runner_0-arrived", 0, WON),
        ([at(1, -4.1)], 500, "runner_1-arrived", 1, LOST),
        ([at(0, 4.1), at(1, -4.1)], 500, "both-arrived", NO_WINNER, (0, 0)),
        ([at(0, 4.1)], 1, "runner_0-arrived", 0, WON),
        ([at(0, -4.5), at(1, 4.5)], 500, None, NO_WINNER, (0, 0)),
        ([down(0)], 500, None, NO_WINNER, (0, 0)),
        ([down(0), down(1)], 500, "both-down", NO_WINNER, (0, 0)),
        ([down(1), at(1, -4.3)], 500, "runner_1-arrived", 1, LOST),
        ([down(0), down(1)], 1, "both-down", NO_WINNER, (0, 0)),
        ([], 1, "time-up", NO_WINNER, (0, 0)),
    ],
)
def test_played_out(name, prepare, max_steps, ending, winner, sparse) -> None:
    game = staged(name, max_steps=max_steps)
    for change in prepare:
        change(game)
    step = play_on(game)
    assert cause(game, step) == ending
    assert step.winner[0] == winner
    np.testing.assert_array_equal(step.sparse[:, 0], sparse)
    np.testing.assert_array_equal(step.shaping, step.dense)


@pytest.mark.parametrize(("x", "turn", "arrived"), [(3.95, LYING_FRONT, True), (4.05, LYING_BACK, False)])
def test_the_mass_centre_must_cross(x: float, turn: list[float], arrived: bool) -> None:
    """Lying in the air across the line, feet first and head first."""
    game = staged("run-to-goal-humans")
    put(game, 0, x, 1.5, turn)
    assert play_on(game).done[0] == arrived


@pytest.mark.parametrize(("height", "fall", "sign"), [(1.0, 0, 1), (0.3, -1, -1)])
@pytest.mark.parametrize("side", [0, 1])
def test_dense_rewards_of_ants_by_hand(height: float, fall: float, sign: int, side: int) -> None:
    """Flying on its back towards +x, which is forward for side 0 only; the fall brings it below 0.28 m."""
    game = staged("run-to-goal-ants")
    robot = game.robots[side]
    put(game, side, 2 * side - 1, height, ON_ITS_BACK)
    robot.qvel[:, :3] = [2, 0, fall]
    step = play_on(game, action=1.5)
    forward = 2.0 if side == 0 else -2.0
    contact = 0.5e-3 * np.square(robot.contact_force.clip(-1, 1)).sum()
    expected = forward - 0.5 * 8 * 1.5**2 - contact + sign
    # near the ground friction takes some of the speed
    assert step.dense[side, 0] == pytest.approx(expected, abs=0.05 if sign > 0 else 0.3)


@BOTH_GAMES
def test_start_of_games(name: str) -> None:
    game = make_game(name, num_envs=400)
    game.seed(5)
    game.reset()
    poses = game.physics.model.qpos0.reshape(2, -1)
    height = 0.75 if "ants" in name else 1.4
    for side, x in ((0, -1), (1, 1)):
        robot = game.robots[side]
        assert poses[side, :3].tolist() == [x, 0, height]
        assert robot.qvel.std() == pytest.approx(0.1, rel=0.05)
        np.testing.assert_allclose(np.linalg.norm(robot.qpos[:, 3:7], axis=1), 1)
        free = np.delete(robot.qpos - poses[side], range(3, 7), axis=1)
        assert 0.099 < np.abs(free).max() <= 0.1
        assert free.std() == pytest.approx(0.2 / 12**0.5, rel=0.03)
