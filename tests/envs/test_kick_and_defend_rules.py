"""Every ending of kick-and-defend, by hand: the pure rules, and played out from a prepared state."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from apil_core import NO_WINNER, GameStep
from apil_envs.game_base import GOES_ON
from apil_envs.kick_and_defend import (
    CAUSES,
    KEEPER,
    KICKER,
    KickAndDefend,
    KickAndDefendOptions,
    decide,
)

LYING = [0.7071067811865476, 0, 0.7071067811865476, 0]


def one_game(max_steps: int = 500) -> KickAndDefend:
    """Players upright in mid-air, well apart, and the ball at rest on the floor between them."""
    game = KickAndDefend(1, options=KickAndDefendOptions(max_steps=max_steps))
    game.seed(0)
    game.reset()
    game.physics.qpos[:] = game.physics.model.qpos0
    game.physics.qvel[:] = 0
    game.ball.position[:] = [0, 0, 0.15]
    return game


def settle(game: KickAndDefend) -> None:
    """Make the prepared state the one the step starts from."""
    game.physics.forward()
    for side, robot in enumerate(game.robots):
        game._centre_before[side] = robot.centre


def play_on(game: KickAndDefend) -> GameStep:
    settle(game)
    still = np.zeros((1, 17), np.float32)
    return game.step((still, still))


def ball_at(x: float, y: float, vx: float) -> Callable[[KickAndDefend], None]:
    def prepare(game: KickAndDefend) -> None:
        game.ball.position[:] = [x, y, 0.6]
        game.ball.velocity[:] = [vx, 0, 0]

    return prepare


def lie_down(game: KickAndDefend) -> None:
    for robot in game.robots:
        robot.qpos[:, 2] = 0.3
        robot.qpos[:, 3:7] = LYING


def keeper_lies_kicker_stands(game: KickAndDefend) -> None:
    game.robots[KEEPER].qpos[:, 2] = 0.3
    game.robots[KEEPER].qpos[:, 3:7] = LYING


def keeper_forward(game: KickAndDefend) -> None:
    game.robots[KEEPER].qpos[:, 0] = 1.4


def touched(game: KickAndDefend) -> None:
    game.touched[:] = True


@pytest.mark.parametrize(
    ("prepare", "max_steps", "cause", "winner", "sparse"),
    [
        ([ball_at(3.99, 0, 5)], 500, "goal", KICKER, (1000, -1000)),
        ([ball_at(3.99, -2.9, 5)], 500, "goal", KICKER, (1000, -1000)),
        ([ball_at(3.99, 3.2, 5)], 500, "ball-outside", KEEPER, (-1000, 1500)),
        ([ball_at(3.99, 3.2, 5), touched], 500, "ball-outside", KEEPER, (-1000, 2000)),
        ([ball_at(1, 2, -1.5)], 500, "ball-turned-back", KEEPER, (-1000, 1500)),
        ([ball_at(1, 2, -0.5)], 500, None, NO_WINNER, (0, 0)),
        ([lie_down], 500, "both-down", KEEPER, (-1000, 1000)),
        ([lie_down, touched], 500, "both-down", KEEPER, (-1000, 1500)),
        ([keeper_lies_kicker_stands], 500, None, NO_WINNER, (0, 0)),
        ([], 1, "time-up", KEEPER, (-1000, 1500)),
        ([keeper_forward], 500, "keeper-left-goal", NO_WINNER, (0, -1000)),
        ([keeper_forward], 1, "time-up", KEEPER, (-1000, 1500)),
        ([keeper_forward, ball_at(3.99, 0, 5)], 500, "goal", KICKER, (1000, -1000)),
        ([], 500, None, NO_WINNER, (0, 0)),
    ],
)
def test_endings(
    prepare: list[Callable[[KickAndDefend], None]],
    max_steps: int,
    cause: str | None,
    winner: int,
    sparse: tuple[float, float],
) -> None:
    game = one_game(max_steps)
    for change in prepare:
        change(game)
    step = play_on(game)
    assert step.done[0] == (cause is not None)
    if cause is not None:
        assert CAUSES[step.cause[0]] == cause
    assert step.winner[0] == winner
    np.testing.assert_array_equal(step.sparse[:, 0], sparse)


def test_dense_rewards_by_hand() -> None:
    """Both stand in mid-air without contacts; at full action the control cost is 0.1 · 17 · 0.4²."""
    game = one_game()
    game.robots[KICKER].qvel[:, 0] = 2.0
    game.ball.position[:] = [0, 1, 0.15]
    settle(game)
    full = np.full((1, 17), 7.0, np.float32)  # far beyond the bounds: the cost is on clipped actions
    step = game.step((full, full))
    control = 0.1 * 17 * 0.4**2
    x, y = game.robots[KICKER].qpos[0, :2]
    ball_x, ball_y = game.ball.position[0, :2]
    distance = np.hypot(x - ball_x, y - ball_y)
    # RK4's last stage lies at the end of the substep, so the mass centre has come all of the way
    forward = 0.25 * (2.0 * 0.015) / 0.003
    assert step.dense[KICKER, 0] == pytest.approx(forward - control + 5 - distance, abs=0.05)
    assert step.dense[KEEPER, 0] == pytest.approx(5 - control, abs=1e-5)
    to_goal = 4 - ball_x
    assert step.shaping[KICKER, 0] == pytest.approx(step.dense[KICKER, 0] - to_goal, abs=1e-4)
    assert step.shaping[KEEPER, 0] == pytest.approx(step.dense[KEEPER, 0] + to_goal, abs=1e-4)


@pytest.mark.parametrize(("x", "y", "sign"), [(3.0, 0.0, 1), (4.2, 0.0, -1), (3.0, 3.1, -1)])
def test_keeper_is_paid_for_staying_in_the_goal(x: float, y: float, sign: int) -> None:
    game = one_game()
    game.robots[KEEPER].qpos[:, :2] = [x, y]
    assert play_on(game).dense[KEEPER, 0] == pytest.approx(5 * sign, abs=1e-4)


@pytest.mark.parametrize(("gap", "touch"), [(-0.01, True), (0.0005, False), (0.6, False)])
def test_touch_needs_penetration_not_just_the_margin(gap: float, touch: bool) -> None:
    game = one_game()
    x, y, z = game.robots[KEEPER].qpos[0, :3]
    game.ball.position[:] = [x - 0.07 - 0.15 - gap, y, z]  # before the torso, radius 0.07
    game.physics.forward()
    game.judge()
    assert game.touched[0] == touch


def test_the_kickers_touch_does_not_count() -> None:
    game = one_game()
    x, y, z = game.robots[KICKER].qpos[0, :3]
    game.ball.position[:] = [x + 0.2, y, z]
    game.physics.forward()
    game.judge()
    assert not game.touched[0]


NUMBER = st.floats(-6, 6)


@given(
    ball=st.tuples(NUMBER, NUMBER, st.floats(0, 2)),
    velocity=st.tuples(NUMBER, NUMBER, NUMBER),
    heights=st.tuples(st.floats(0, 2), st.floats(0, 2)),
    keeper_x=NUMBER,
    touch=st.booleans(),
    time_up=st.booleans(),
)
def test_rewards_agree_with_winner_and_cause(ball, velocity, heights, keeper_x, touch, time_up) -> None:
    verdict = decide(
        np.array([ball]),
        np.array([velocity]),
        np.array(heights)[:, None],
        np.array([keeper_x]),
        np.array([touch]),
        np.array([time_up]),
    )
    kicker, keeper = verdict.sparse[:, 0]
    cause = verdict.cause[0]
    if verdict.winner[0] == KICKER:
        assert (CAUSES[cause], kicker, keeper) == ("goal", 1000, -1000)
    elif verdict.winner[0] == KEEPER:
        assert kicker == -1000
        assert keeper == 1000 + 500 * touch + 500 * (heights[1] > 0.8)
    elif cause == GOES_ON:
        assert kicker == keeper == 0
        assert not time_up
        assert ball[0] <= 4
    else:
        assert (CAUSES[cause], kicker, keeper) == ("keeper-left-goal", 0, -1000)


def test_start_of_games() -> None:
    game = KickAndDefend(400)
    game.seed(5)
    game.reset()
    kicker, keeper = game.robots
    for robot, low, high in ((kicker, -3.5, -0.5), (keeper, 1.6, 3.5)):
        assert low <= robot.qpos[:, 0].min()
        assert robot.qpos[:, 0].max() <= high
        assert robot.qpos[:, 0].std() == pytest.approx((high - low) / 12**0.5, rel=0.15)
        assert np.abs(robot.qpos[:, 1]).max() <= 2
        assert np.abs(robot.qpos[:, 2] - 1.5).max() <= 0.1
        np.testing.assert_allclose(np.linalg.norm(robot.qpos[:, 3:7], axis=1), 1)
        assert robot.qvel.std() == pytest.approx(0.1, rel=0.05)
    ball, speed = game.ball.position, game.ball.velocity
    np.testing.assert_array_equal(ball[:, 2], 0.35)
    assert ball[:, 0].min() >= -2
    assert ball[:, 0].max() <= 1
    assert np.abs(ball[:, 1]).max() <= 4
    changed = (speed == 0.1).all(1)
    assert (speed[:, 0] > 0).all()
    assert 0.4 < changed.mean() < 0.6
