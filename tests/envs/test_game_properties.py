"""The laws of ``game_laws`` under disorder: any seed, actions, resets, pauses, places and broken physics."""

from __future__ import annotations

from functools import cache

import mujoco
import numpy as np
import pytest
from helpers.every_game import GAME_NAMES, short_game
from hypothesis import given, settings
from hypothesis import strategies as st

from apil_core import Game
from apil_envs.game_base import MujocoGame

from .game_laws import OUTCOMES, Before, check
from .soak import soak

GAMES, STEPS, MAX_STEPS = 8, 12, 10
POISONS = (np.nan, np.inf, -1e30)


@cache
def game_of(name: str) -> Game:
    """Made once: every example starts it anew."""
    return short_game(name, GAMES, max_steps=MAX_STEPS)


class Disorder:
    """Random meddling with a game, row by row.

    Args:
        game: to play.
        seed: of everything.
        scale: of the actions, in units of their bound.
        chaos: probability per game and step of each kind of meddling.
    """

    def __init__(self, game: Game, seed: int, scale: float, chaos: float):
        self.game = game
        self.scale = scale
        self.chaos = chaos
        self.rng = np.random.default_rng(seed)
        game.seed(seed)
        game.reset()
        self.over = np.zeros(GAMES, bool)
        self.lengths = np.zeros(GAMES, int)

    def some(self) -> np.ndarray:
        return self.rng.random(GAMES) < self.chaos

    def actions(self) -> tuple[np.ndarray, np.ndarray]:
        first, second = (
            self.rng.normal(0, self.scale * side.action_high, (GAMES, side.action_size)).astype(np.float32)
            for side in self.game.layout.sides
        )
        return first, second

    def reset_some(self) -> None:
        rows = self.some() | self.over & (self.rng.random(GAMES) < 0.5)
        self.game.reset(rows)
        self.over[rows] = False
        self.lengths[rows] = 0

    def move_some(self) -> None:
        """Put robots and ball anywhere: beyond lines and edges, on and in the ground, into each other."""
        if not isinstance(self.game, MujocoGame):
            return
        model = self.game.physics.model
        for joint in np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE):
            rows = np.flatnonzero(self.some() & (self.rng.random(GAMES) < 0.5))
            place, speed = model.jnt_qposadr[joint], model.jnt_dofadr[joint]
            where = self.rng.uniform([-5, -4, 0], [5, 4, 2], (len(rows), 3))
            self.game.physics.qpos[rows, place : place + 3] = where
            self.game.physics.qvel[rows, speed : speed + 3] = self.rng.normal(0, 2, (len(rows), 3))
        for array in self.game.rule_state().values():
            if array.dtype == bool:  # who touched whom
                array[self.some()] = True

    def poison_some(self) -> np.ndarray:
        """Break the physics of a few games; returns which."""
        rows = self.some() & (self.rng.random(GAMES) < 0.1)
        if not isinstance(self.game, MujocoGame):
            return np.zeros(GAMES, bool)
        for row in np.flatnonzero(rows):
            where = self.game.physics.qvel if self.rng.random() < 0.5 else self.game.physics.qpos
            where[row, self.rng.integers(where.shape[1])] = self.rng.choice(POISONS)
        return rows

    def play(self, name: str) -> list[str]:
        """``STEPS`` steps, all checked; returns the endings."""
        endings: list[str] = []
        for _ in range(STEPS):
            self.reset_some()
            active = ~self.some()
            active[0] |= not self.lengths.any()  # at the very start somebody must play
            playing = active & ~self.over
            self.move_some()
            poisoned = self.poison_some() & playing
            observations = tuple(o.copy() for o in self.game.observations)
            before = Before(playing, self.lengths.copy(), observations)
            step = self.game.step(self.actions(), active)
            check(name, self.game, before, step)
            causes = [self.game.layout.causes[c] for c in step.cause[step.done]]
            diverged = np.zeros(GAMES, bool)
            diverged[step.done] = [cause == "diverged" for cause in causes]
            assert diverged[poisoned].all(), "broken physics went unnoticed"
            endings += causes
            self.over |= step.done
            self.lengths += playing
        return endings


@pytest.mark.parametrize("name", GAME_NAMES)
def test_every_ending_has_its_law(name: str) -> None:
    if name not in OUTCOMES:
        pytest.skip(f"{name} is not a game of apil_envs")
    assert set(OUTCOMES[name]) == set(game_of(name).layout.causes)


@pytest.mark.parametrize("name", OUTCOMES)
@settings(max_examples=8)
@given(
    seed=st.integers(0, 2**32 - 1),
    scale=st.sampled_from([0.0, 0.3, 1.0, 30.0, 1e4]),
    chaos=st.sampled_from([0.0, 0.1, 0.4]),
)
def test_laws_hold(name: str, seed: int, scale: float, chaos: float) -> None:
    Disorder(game_of(name), seed, scale, chaos).play(name)


@pytest.mark.parametrize("name", [name for name in OUTCOMES if name != "toy-pursuit"])
def test_disorder_meets_most_endings(name: str) -> None:
    """Otherwise the property above would say little."""
    met: set[str] = set()
    for seed in range(8):
        met |= set(Disorder(game_of(name), seed, 1.0, chaos=0.03 if seed % 4 == 0 else 0.2).play(name))
    assert len(met) >= 0.6 * len(OUTCOMES[name]), met


@pytest.mark.slow
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("name", OUTCOMES)
def test_a_million_random_steps(name: str) -> None:
    result = soak(name, 1_000_000)
    print(result)
    assert result.steps >= 1_000_000
    assert result.endings.total() > 1000
