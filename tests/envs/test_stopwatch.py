"""The stopwatch does exactly what the game's physics did, and disturbs nothing."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.every_game import GAME_NAMES, short_game

from apil_core import Game
from apil_envs.game_base import MujocoGame
from apil_envs.stopwatch import BatchStopwatch

GAMES = 3
MUJOCO_GAMES = [name for name in GAME_NAMES if isinstance(short_game(name), MujocoGame)]


def play(game: Game, steps: int, seed: int = 1) -> None:
    """Random actions; ended games start anew."""
    rng = np.random.default_rng(seed)
    for _ in range(steps):
        actions = [
            rng.normal(0, side.action_high, (GAMES, side.action_size)).astype(np.float32)
            for side in game.layout.sides
        ]
        game.reset(game.step((actions[0], actions[1])).done)


def started(name: str, max_steps: int = 20) -> MujocoGame:
    game = short_game(name, GAMES, threads=2, max_steps=max_steps)
    assert isinstance(game, MujocoGame)
    game.seed(0)
    game.reset()
    return game


def bound(stopwatch: BatchStopwatch) -> dict[str, np.ndarray]:
    return {name: np.array(field) for name, field in stopwatch.replayed._bound.items()}


@pytest.mark.parametrize("name", MUJOCO_GAMES)
def test_replayed_states_and_derived_fields_are_the_games_own(name: str) -> None:
    game = started(name)
    play(game, 25)  # into the second games, with rings of their own
    stopwatch = game.physics_stopwatch()
    stopwatch.record()
    play(game, 8)  # no game ends: what was read after the last step stands
    assert stopwatch.stop() > 0
    assert stopwatch.replay() > 0
    np.testing.assert_array_equal(stopwatch.replayed.state, game.physics.state)
    batch = game.physics._batch
    assert set(stopwatch.replayed._bound) == set(batch._bound) != set()
    for field, values in bound(stopwatch).items():
        np.testing.assert_array_equal(values, batch.bind(field), err_msg=field)


def test_the_game_goes_on_as_if_nobody_had_listened() -> None:
    watched, alone = started("sumo-ants"), started("sumo-ants")
    stopwatch = watched.physics_stopwatch()
    for seed in range(3):
        stopwatch.record()
        play(watched, 10, seed)
        stopwatch.stop()
        stopwatch.replay()
        play(alone, 10, seed)
    np.testing.assert_array_equal(watched.physics.state, alone.physics.state)
    for ours, theirs in zip(watched.observations, alone.observations, strict=True):
        np.testing.assert_array_equal(ours, theirs)


def test_calls_are_kept_only_while_recording_and_only_once() -> None:
    game = started("sumo-ants")
    stopwatch = game.physics_stopwatch()
    play(game, 2)
    assert stopwatch.replay() == 0
    stopwatch.record()
    play(game, 2)
    stopwatch.stop()
    play(game, 2)
    assert len(stopwatch._calls) == 2
    stopwatch.record()
    play(game, 1)
    assert len(stopwatch._calls) == 1
    stopwatch.close()
    stopwatch.close()
    play(game, 1)
    assert stopwatch._calls == []


def test_games_that_stand_still_are_not_stepped_in_the_replay_either() -> None:
    game = started("sumo-ants", max_steps=100)
    active = np.array([True, False, True])
    stopwatch = game.physics_stopwatch()
    stopwatch.record()
    zeros = np.zeros((GAMES, game.layout.sides[0].action_size), np.float32)
    game.step((zeros, zeros), active)
    active[:] = True  # the mask is the caller's to write again
    stopwatch.stop()
    before = stopwatch._calls[0].state.copy()
    stopwatch.replay()
    np.testing.assert_array_equal(stopwatch.replayed.state, game.physics.state)
    np.testing.assert_array_equal(stopwatch.replayed.state[1], before[1])
    assert (stopwatch.replayed.state[0] != before[0]).any()


def test_a_game_without_physics_of_its_own_has_no_stopwatch() -> None:
    assert short_game("toy-pursuit").physics_stopwatch() is None
