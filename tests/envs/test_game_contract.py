"""What ``apil_core.Game`` promises, for every game of this package."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from functools import partial

import numpy as np
import pytest
from core.every_game import GAME_NAMES, short_game

from apil_core import NO_WINNER, ApilError, Game, GameStep
from apil_envs.game_base import MujocoGame

GAMES = 6


MAKERS = pytest.mark.parametrize("make", [partial(short_game, name) for name in GAME_NAMES], ids=GAME_NAMES)
MUJOCO_GAMES = [name for name in GAME_NAMES if isinstance(short_game(name), MujocoGame)]


class Play:
    """Random actions from a seed; ended games restart; records every observation and reward."""

    def __init__(self, game: Game, seed: int):
        self.game = game
        self.rng = np.random.default_rng(seed)
        self.trace: list[np.ndarray] = []

    def actions(self) -> tuple[np.ndarray, np.ndarray]:
        first, second = (
            self.rng.normal(0, side.action_high, (self.game.num_envs, side.action_size)).astype(np.float32)
            for side in self.game.layout.sides
        )
        return first, second

    def run(self, steps: int) -> GameStep:
        for _ in range(steps):
            step = self.game.step(self.actions())
            self.trace += [o.copy() for o in self.game.observations]
            self.trace += [step.sparse, step.dense, step.shaping, step.done, step.winner, step.cause]
            if step.done.any():
                self.game.reset(step.done)
                self.trace += [o.copy() for o in self.game.observations]
        return step


def assert_same(first: Play, second: Play) -> None:
    assert len(first.trace) == len(second.trace)
    for a, b in zip(first.trace, second.trace, strict=True):
        np.testing.assert_array_equal(a, b)


def started(game: Game, seed: int = 0) -> Game:
    game.seed(seed)
    game.reset()
    return game


@MAKERS
def test_shapes_and_types(make: Callable[..., Game]) -> None:
    game = started(make(GAMES))
    step = Play(game, 0).run(1)
    for side, observation in zip(game.layout.sides, game.observations, strict=True):
        assert observation.shape == (GAMES, side.observation_size)
        assert observation.dtype == np.float32
        assert list(side.blocks.values())[-1].stop == side.observation_size
    for reward in (step.sparse, step.dense, step.shaping):
        assert (reward.shape, reward.dtype) == ((2, GAMES), np.float32)
    assert (step.done.shape, step.done.dtype) == ((GAMES,), bool)
    assert (step.winner.dtype, step.cause.dtype, step.lengths.dtype) == (np.int8, np.int8, np.int32)


@MAKERS
def test_same_seed_same_games_at_any_number_of_threads(make: Callable[..., Game]) -> None:
    plays = [Play(started(make(GAMES, threads=threads), 7), 1) for threads in (1, 2, 4)]
    for play in plays:
        play.run(30)
    assert_same(plays[0], plays[1])
    assert_same(plays[0], plays[2])


@MAKERS
def test_seeds_differ(make: Callable[..., Game]) -> None:
    one, two = started(make(2), 1), started(make(2), 2)
    assert (one.observations[0] != two.observations[0]).any()


@MAKERS
def test_state_goes_through_a_dict_bit_for_bit(make: Callable[..., Game]) -> None:
    first = Play(started(make(GAMES), 3), 5)
    first.run(27)  # past the first restarts
    state = copy.deepcopy(first.game.state_dict())
    random = copy.deepcopy(first.rng.bit_generator.state)
    second = Play(make(GAMES), 0)
    second.game.load_state_dict(state)
    second.rng.bit_generator.state = random
    for before, after in zip(first.game.observations, second.game.observations, strict=True):
        np.testing.assert_array_equal(before, after)
    first.trace.clear()
    first.run(35)
    second.run(35)
    assert_same(first, second)


@MAKERS
def test_state_holds_plain_data_only(make: Callable[..., Game]) -> None:
    def plain(value: object) -> bool:
        if isinstance(value, dict):
            return all(isinstance(key, str) and plain(item) for key, item in value.items())
        return isinstance(value, np.ndarray | int | float | str)

    state = started(make(2)).state_dict()
    assert plain(state)
    json.loads(state["random"])


@MAKERS
def test_reset_changes_the_masked_rows_only(make: Callable[..., Game]) -> None:
    game = started(make(GAMES))
    Play(game, 0).run(3)
    before = [o.copy() for o in game.observations]
    mask = np.arange(GAMES) % 2 == 0
    game.reset(mask)
    for old, new in zip(before, game.observations, strict=True):
        np.testing.assert_array_equal(old[~mask], new[~mask])
        assert (old[mask] != new[mask]).any(axis=1).all()


@MAKERS
def test_inactive_games_stand_still(make: Callable[..., Game]) -> None:
    """The others play on as if nothing had been held; the held ones continue where they were."""
    held, free = started(make(GAMES), 2), started(make(GAMES), 2)
    play = Play(free, 4)
    active = np.arange(GAMES) < 4
    for _ in range(5):
        actions = play.actions()
        before = [o[~active].copy() for o in held.observations]
        step = held.step(actions, active)
        full = free.step(actions)
        for old, new in zip(before, held.observations, strict=True):
            np.testing.assert_array_equal(old, new[~active])
        assert not step.done[~active].any()
        assert (step.lengths[~active] == 0).all()
        for reward in (step.sparse, step.dense, step.shaping):
            assert (reward[:, ~active] == 0).all()
        np.testing.assert_array_equal(step.dense[:, active], full.dense[:, active])
        for one, other in zip(held.observations, free.observations, strict=True):
            np.testing.assert_array_equal(one[active], other[active])


@MAKERS
def test_nobody_need_play_in_the_first_step(make: Callable[..., Game]) -> None:
    game = started(make(GAMES))
    step = game.step(Play(game, 0).actions(), np.zeros(GAMES, bool))
    assert not step.done.any()
    assert not step.lengths.any()


@MAKERS
def test_ended_games_stay_ended_until_reset(make: Callable[..., Game]) -> None:
    game = started(make(GAMES))
    play = Play(game, 0)
    ended = np.zeros(GAMES, bool)
    for _ in range(70):
        step = game.step(play.actions())
        assert not (step.done & ended).any()
        assert (step.dense[:, ended] == 0).all()
        ended |= step.done
    assert ended.all()
    game.reset()
    assert not game.step(play.actions()).done.any()


@MAKERS
def test_old_observations_survive_one_step(make: Callable[..., Game]) -> None:
    game = started(make(GAMES))
    play = Play(game, 0)
    for _ in range(3):
        kept = game.observations
        copies = [o.copy() for o in kept]
        game.step(play.actions())
        for view, saved in zip(kept, copies, strict=True):
            np.testing.assert_array_equal(view, saved)


@MAKERS
def test_step_before_reset_is_an_error(make: Callable[..., Game]) -> None:
    game = make(1)
    with pytest.raises(ApilError, match="reset"):
        game.step(Play(game, 0).actions())


@MAKERS
def test_one_game_alone(make: Callable[..., Game]) -> None:
    step = Play(started(make(1)), 0).run(25)
    assert step.done.shape == (1,)


@pytest.mark.parametrize("poison", [np.nan, np.inf, 1e30, -2e10])
@pytest.mark.parametrize("name", MUJOCO_GAMES)
def test_divergence_ends_that_game_alone(name: str, poison: float) -> None:
    broken, sane = started(short_game(name, GAMES), 1), started(short_game(name, GAMES), 1)
    assert isinstance(broken, MujocoGame)
    play = Play(sane, 3)
    broken.physics.qvel[2, 7] = poison
    actions = play.actions()
    step, expected = broken.step(actions), sane.step(actions)
    others = np.arange(GAMES) != 2
    assert step.done[2]
    assert step.winner[2] == NO_WINNER
    assert broken.layout.causes[step.cause[2]] == "diverged"
    for reward in (step.sparse, step.dense, step.shaping):
        assert (reward[:, 2] == 0).all()
    assert not step.done[others].any()
    np.testing.assert_array_equal(step.dense[:, others], expected.dense[:, others])
    for seen, wanted in zip(broken.observations, sane.observations, strict=True):
        assert np.isfinite(seen).all()
        np.testing.assert_array_equal(seen[others], wanted[others])
    broken.reset(step.done)
    after = broken.step(actions)
    assert np.isfinite(after.dense).all()
    assert not after.done.any()
