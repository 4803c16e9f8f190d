"""Every ending of sumo: the pure rules against plain Python, and played out from prepared states."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from apil_core import NO_WINNER
from apil_core.plugins.registry import make_game
from apil_envs.game_base import MujocoGame
from apil_envs.sumo import CAUSES, decide

from . import rule_reference
from .staged import LYING_BACK, ON_ITS_BACK, around, cause, play_on, put, staged

RADIUS = 2.0
ABOVE, BELOW = np.nextafter(RADIUS, 9), np.nextafter(RADIUS, 0)
LOSE, WIN = -1000, 1000

BOTH_GAMES = pytest.mark.parametrize("name", ["sumo-humans", "sumo-ants"])
DOWN = {"sumo-humans": (0.9, LYING_BACK), "sumo-ants": (0.795, ON_ITS_BACK)}
"""Height (m) and attitude in which a fighter is down without touching the ring yet."""


@given(st.sampled_from([0.8, 1.0]), st.floats(1.5, 4.5), st.booleans(), st.booleans(), st.data())
def test_decide_is_the_plain_rule_book(floor, radius, touched, time_up, data) -> None:
    heights = data.draw(st.tuples(around(floor), around(floor)))
    distances = data.draw(st.tuples(around(radius), around(radius)))
    expected = rule_reference.sumo(heights, distances, radius, floor, touched, time_up)
    verdict = decide(
        np.array(heights)[:, None],
        np.array(distances)[:, None],
        np.array([radius]),
        np.array([touched]),
        np.array([time_up]),
        fallen=floor,
    )
    assert (CAUSES[verdict.cause[0]] if verdict.cause[0] >= 0 else None) == expected.cause
    assert verdict.winner[0] == expected.winner
    np.testing.assert_array_equal(verdict.sparse[:, 0], expected.sparse)


@pytest.mark.parametrize(
    ("heights", "distances", "touched", "late", "ending", "winner", "sparse"),
    [
        ((1.5, 1.5), (1, 1), True, False, None, NO_WINNER, (0, 0)),
        ((1.0, 1.5), (1, 1), True, False, "fighter_0-fell", 1, (LOSE, WIN)),
        ((np.nextafter(1.0, 2), 1.5), (1, 1), True, False, None, NO_WINNER, (0, 0)),
        ((1.5, 1.0), (1, 1), True, False, "fighter_1-fell", 0, (WIN, LOSE)),
        ((1.5, 1.0), (1, 1), False, False, "fighter_1-fell-untouched", NO_WINNER, (0, LOSE)),
        ((0.5, 1.0), (1, 1), True, False, "both-fell", NO_WINNER, (LOSE, LOSE)),
        ((0.5, 1.0), (1, 1), False, False, "both-fell", NO_WINNER, (LOSE, LOSE)),
        ((1.5, 1.5), (RADIUS, 1), True, False, None, NO_WINNER, (0, 0)),
        ((1.5, 1.5), (ABOVE, 1), True, False, "fighter_0-left-ring", 1, (LOSE, WIN)),
        ((1.5, 1.5), (ABOVE, 1), False, False, "fighter_0-left-ring-untouched", NO_WINNER, (LOSE, 0)),
        ((1.5, 1.5), (1, ABOVE), True, False, "fighter_1-left-ring", 0, (WIN, LOSE)),
        ((1.5, 1.5), (3, 3), True, False, "both-left-ring", NO_WINNER, (LOSE, LOSE)),
        # falling goes before leaving the ring, and both before the time
        ((0.9, 1.5), (1, 3), True, True, "fighter_0-fell", 1, (LOSE, WIN)),
        ((1.5, 0.9), (3, 3), True, True, "fighter_1-fell", 0, (WIN, LOSE)),
        ((0.9, 0.9), (1, 3), True, True, "both-fell", NO_WINNER, (LOSE, LOSE)),
        ((1.5, 1.5), (1, 3), True, True, "fighter_1-left-ring", 0, (WIN, LOSE)),
        ((1.5, 1.5), (1, BELOW), True, True, "time-up", NO_WINNER, (LOSE, LOSE)),
        ((1.5, 1.5), (1, 1), False, True, "time-up", NO_WINNER, (LOSE, LOSE)),
    ],
)
def test_the_table(heights, distances, touched, late, ending, winner, sparse) -> None:
    for expected in (
        rule_reference.sumo(heights, distances, RADIUS, 1.0, touched, late),
        rule_reference.Outcome(ending, winner, sparse),
    ):
        verdict = decide(
            np.array(heights)[:, None],
            np.array(distances)[:, None],
            np.array([RADIUS]),
            np.array([touched]),
            np.array([late]),
            fallen=1.0,
        )
        assert (CAUSES[verdict.cause[0]] if verdict.cause[0] >= 0 else None) == expected.cause
        assert verdict.winner[0] == expected.winner
        np.testing.assert_array_equal(verdict.sparse[:, 0], expected.sparse)


def ring(name: str, **options: float) -> MujocoGame:
    """Both well above the ring of radius 2, far apart."""
    game = staged(name, **options)
    game.radius[:] = RADIUS
    put(game, 0, -1.2, 1.9)
    put(game, 1, 1.2, 1.9)
    return game


def fall(side: int) -> Callable[[MujocoGame], None]:
    return lambda game: put(game, side, game.robots[side].qpos[0, 0], *DOWN[str(game.scene)])


def leave(side: int) -> Callable[[MujocoGame], None]:
    return lambda game: put(game, side, RADIUS + 0.01 if side else -RADIUS - 0.01)


def stay_on_the_edge(game: MujocoGame) -> None:
    put(game, 0, -RADIUS + 0.01)


def have_touched(game: MujocoGame) -> None:
    game.touched[:] = True


@BOTH_GAMES
@pytest.mark.parametrize(
    ("prepare", "options", "ending", "winner", "sparse"),
    [
        ([], {}, None, NO_WINNER, (0, 0)),
        ([stay_on_the_edge], {}, None, NO_WINNER, (0, 0)),
        ([fall(0), have_touched], {}, "fighter_0-fell", 1, (LOSE, WIN)),
        ([fall(0)], {}, "fighter_0-fell-untouched", NO_WINNER, (LOSE, 0)),
        ([fall(0)], {"untouched_reward": -1000}, "fighter_0-fell-untouched", NO_WINNER, (LOSE, LOSE)),
        ([fall(1)], {"auto_contact": True}, "fighter_1-fell", 0, (WIN, LOSE)),
        ([leave(1), have_touched], {}, "fighter_1-left-ring", 0, (WIN, LOSE)),
        ([leave(1)], {}, "fighter_1-left-ring-untouched", NO_WINNER, (0, LOSE)),
        ([leave(0)], {"auto_contact": True}, "fighter_0-left-ring", 1, (LOSE, WIN)),
        ([leave(0), leave(1), have_touched], {}, "both-left-ring", NO_WINNER, (LOSE, LOSE)),
        ([fall(0), fall(1)], {"auto_contact": True}, "both-fell", NO_WINNER, (LOSE, LOSE)),
        ([leave(0), fall(1), have_touched], {}, "fighter_1-fell", 0, (WIN, LOSE)),
        ([], {"max_steps": 1, "auto_contact": True}, "time-up", NO_WINNER, (LOSE, LOSE)),
        ([leave(0)], {"max_steps": 1, "auto_contact": True}, "fighter_0-left-ring", 1, (LOSE, WIN)),
    ],
)
def test_played_out(name, prepare, options, ending, winner, sparse) -> None:
    game = ring(name, **options)
    for change in prepare:
        change(game)
    step = play_on(game)
    assert cause(game, step) == ending
    assert step.winner[0] == winner
    np.testing.assert_array_equal(step.sparse[:, 0], sparse)


@BOTH_GAMES
def test_a_touch_in_the_last_step_counts(name: str) -> None:
    """Side 0 lies right under the other."""
    game = ring(name)
    height, turn = DOWN[name]
    put(game, 0, 0, height, turn)
    put(game, 1, 0, height + (0.1 if name == "sumo-humans" else 0.45), turn)
    step = play_on(game)
    assert game.touched[0]
    assert cause(game, step) == "fighter_0-fell"
    assert step.winner[0] == 1


@BOTH_GAMES
def test_touches_last_until_the_reset(name: str) -> None:
    game = ring(name)
    have_touched(game)
    assert cause(game, play_on(game)) is None
    assert game.touched[0]
    game.reset()
    assert not game.touched[0]


@pytest.mark.parametrize(("gap", "touch"), [(-0.01, True), (0.005, False), (0.02, False)])
def test_touch_needs_penetration_not_just_the_margin(gap: float, touch: bool) -> None:
    """One ant right above the other: the torsos, of radius 0.25, are nearest."""
    game = ring("sumo-ants")
    put(game, 0, 0, 1.5)
    put(game, 1, 0, 1.5 + 0.5 + gap)
    game.physics.forward()
    game.judge()
    assert game.touched[0] == touch


@pytest.mark.parametrize(("height", "sign"), [(0.795, 1), (0.77, -1)])
def test_the_dying_ant(height: float, sign: int) -> None:
    """It falls at 0.8 m but counts as standing down to 0.78 m; it pays for what it asked, unclipped."""
    game = ring("sumo-ants")
    put(game, 0, -1.2, height, ON_ITS_BACK)
    step = play_on(game, action=2.0)
    assert cause(game, step) == "fighter_0-fell-untouched"
    distance = np.hypot(*game.robots[0].qpos[0, :2])
    contact = 0.5e-6 * np.square(game.robots[0].contact_force).sum()
    assert step.dense[0, 0] == pytest.approx(5 * sign - distance - 0.1 * 8 * 2**2 - contact, abs=1e-4)


def test_humans_pay_for_clipped_actions() -> None:
    game = ring("sumo-humans")
    step = play_on(game, action=-3.0)
    distance = np.hypot(*game.robots[1].qpos[0, :2])
    assert step.dense[1, 0] == pytest.approx(5 - distance - 0.1 * 17 * 0.4**2, abs=1e-4)


@pytest.mark.parametrize(
    ("name", "smallest", "largest"), [("sumo-humans", 1.5, 3.5), ("sumo-ants", 2.5, 4.5)]
)
def test_start_of_games(name: str, smallest: float, largest: float) -> None:
    n = 400
    game = make_game(name, num_envs=n)
    game.seed(5)
    game.reset()
    radius, gap = game.radius, 0.3 + smallest / 2
    assert smallest <= radius.min() < smallest + 0.05
    assert largest - 0.05 < radius.max() <= largest
    assert radius.std() == pytest.approx((largest - smallest) / 12**0.5, rel=0.1)
    for side, robot in enumerate(game.robots):
        x, y, z = robot.qpos[:, :3].T
        outward = x if side else -x
        assert outward.min() >= 0.3
        # x and y are uniform between bounds that depend on the ring, and y on x
        across = (outward - 0.3) / (radius - gap - 0.3)
        along = y / (np.sqrt(radius**2 - x**2) - gap)
        for share, low in ((across, 0), (along, -1)):
            assert low <= share.min() < low + 0.05
            assert 0.95 < share.max() <= 1
            assert share.mean() == pytest.approx((low + 1) / 2, abs=0.1)
            assert share.std() == pytest.approx((1 - low) / 12**0.5, rel=0.1)
        assert 0.05 < np.abs(z - 2.5).max() <= 0.1
        np.testing.assert_allclose(np.linalg.norm(robot.qpos[:, 3:7], axis=1), 1)
        assert robot.qvel.std() == pytest.approx(0.1, rel=0.05)
        hinges = robot.qpos[:, 7:]
        assert 0.09 < np.abs(hinges).max() <= 0.1
        part = game.layout.sides[side].blocks["ring_radius"]
        np.testing.assert_allclose(game.observations[side][:, part.start], radius, rtol=1e-6)
    assert not game.touched.any()


def test_auto_contact_starts_touched() -> None:
    game = make_game("sumo-ants", num_envs=3, options={"auto_contact": True})
    game.reset()
    assert game.touched.all()


def test_every_game_has_a_ring_of_its_own() -> None:
    """Nobody stands beyond the ring's edge: an ant let fall there comes down to the floor."""
    game = make_game("sumo-ants", num_envs=2)
    game.seed(0)
    game.reset()
    game.radius[:] = [2.5, 4.5]
    still = np.zeros((2, 8), np.float32)
    game.robots[0].qpos[:, :3] = [-3.9, 0, 1.2]
    game.physics.forward()
    for _ in range(60):
        game.physics.step()
    heights = game.robots[0].height
    assert heights[0] < 0.6 < 0.7 < heights[1]
    game.clock[:] = 0
    assert game.step((still, still)).done[0]
