"""Observations and dense rewards of five games against a plain MjData loop (see ``game_reference``)."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from apil_core.plugins.registry import make_game
from apil_envs.game_base import MujocoGame

from .game_reference import ABOUT_OPPONENT, DESCRIBED, SIZES, Described, OneGame

STEPS = 25
GAMES = 3

EVERY = pytest.mark.parametrize("described", DESCRIBED, ids=lambda game: game.name)


def start(described: Described, num_envs: int = GAMES, threads: int = 1) -> MujocoGame:
    game = make_game(described.name, num_envs=num_envs, threads=threads)
    assert isinstance(game, MujocoGame)
    game.seed(3)
    game.reset()
    return game


def loops_of(game: MujocoGame) -> list[OneGame]:
    """The same simulations, each alone with a model copy of its own."""
    loops = []
    for i in range(game.num_envs):
        model = game.physics._batch.get_model(i)
        data = mujoco.MjData(model)
        mujoco.mj_setState(model, data, game.physics.state[i], mujoco.mjtState.mjSTATE_INTEGRATION)
        mujoco.mj_forward(model, data)
        # forward leaves a warm start behind that the batch does not have
        mujoco.mj_setState(model, data, game.physics.state[i], mujoco.mjtState.mjSTATE_INTEGRATION)
        loops.append(OneGame(model, data))
    return loops


def advance(game: OneGame, actions: tuple[np.ndarray, ...], bound: float) -> OneGame:
    before = game.centres()
    game.data.ctrl[:] = np.concatenate(actions).clip(-bound, bound)
    mujoco.mj_step(game.model, game.data, 5)
    return OneGame(game.model, game.data, game.step + 1, actions, before)


def bring_together(game: MujocoGame, described: Described) -> None:
    """All but the first game: both low above the ground, within reach of each other."""
    first, second = (robot.qpos for robot in game.robots)
    for robot in (first, second):
        robot[1:, 2] = described.height
    first[1:, :2], second[1:, :2] = [-described.apart / 2, 0], [described.apart / 2, 0]
    game.physics.forward()


def touch_each_other(game: OneGame) -> bool:
    sides = [set(game.bodies(side)) for side in (0, 1)]
    pairs = [game.model.geom_bodyid[contact.geom] for contact in game.data.contact]
    return any((a in sides[0]) & (b in sides[1]) | (a in sides[1]) & (b in sides[0]) for a, b in pairs)


def compare_observations(described: Described, game: MujocoGame, loops: list[OneGame]) -> None:
    for side in (0, 1):
        expected = np.array([described.observe(loop, side) for loop in loops])
        np.testing.assert_array_equal(game.observations[side], expected.astype(np.float32))


@EVERY
def test_blocks_tile_the_observation(described: Described) -> None:
    game = start(described, 1)
    assert sum(described.order.values()) == SIZES[described.name]
    edges = np.cumsum([0, *described.order.values()]).tolist()
    blind = [
        column
        for name, edge in zip(described.order, edges, strict=False)
        if name in ABOUT_OPPONENT
        for column in range(edge, edge + described.order[name])
    ]
    for side in game.layout.sides:
        assert list(side.blocks) == list(described.order)
        assert [part.start for part in side.blocks.values()] == edges[:-1]
        assert [part.stop for part in side.blocks.values()] == edges[1:]
        assert side.observation_size == edges[-1]
        assert list(side.opponent_channels) == blind
        assert side.action_size == described.action_size
        assert (side.action_low, side.action_high) == (-described.bound, described.bound)


@EVERY
def test_the_game_is_a_plain_mujoco_loop(described: Described) -> None:
    """Every number bit for bit; most games start near each other, so that they fight, and may end."""
    game = start(described, threads=2)
    compare_observations(described, game, loops_of(game))
    bring_together(game, described)
    loops = loops_of(game)
    rng = np.random.default_rng(1)
    met, felt = np.zeros(GAMES, bool), np.zeros((2, GAMES), bool)
    playing = list(range(GAMES))
    for count in range(STEPS):
        actions = tuple(
            rng.normal(0, described.bound, (GAMES, described.action_size)).astype(np.float32) for _ in (0, 1)
        )
        step = game.step(actions)
        for i in playing:
            loops[i] = advance(loops[i], tuple(a[i] for a in actions), described.bound)
            met[i] |= touch_each_other(loops[i])
            if count:  # in the first step the way counts from where the robots were before we moved them
                dense, shaping = described.rewards(loops[i])
                np.testing.assert_allclose(step.dense[:, i], dense, rtol=1e-5, atol=1e-5)
                np.testing.assert_allclose(step.shaping[:, i], shaping, rtol=1e-5, atol=1e-5)
        compare_observations(described, game, loops)
        felt |= [
            o[:, s.blocks["contact_force"]].any(1)
            for o, s in zip(game.observations, game.layout.sides, strict=True)
        ]
        playing = [i for i in playing if not step.done[i]]
    assert 0 in playing, "the first game ended early"
    assert met[1:].all(), "the robots never touched each other"
    assert felt[:, 1:].all(), "no contact force was ever seen"
