"""Tabular games and policies: hand arithmetic, and properties that hold in all of them."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from players import Scene, scenes

from apil_core.studies.theory.bounds import PINSKER
from apil_theory.games import ADVERSARY, VICTIM, rock_paper_scissors, tug_of_war
from apil_theory.mdp import MDP
from apil_theory.policies import at_distance, kl_bits, random_policy


def test_values_by_hand() -> None:
    """State 0 leads to state 1, worth 2, which stays: V(1) = 2 / (1 − ½) = 4, V(0) = 1 + ½ · 4 = 3."""
    mdp = MDP(np.array([[[0.0, 1.0]], [[0.0, 1.0]]]), np.array([[1.0], [2.0]]), np.array([1.0, 0.0]), 0.5)
    only = np.ones((2, 1))
    assert mdp.values(only) == pytest.approx([3, 4])
    assert mdp.value(only) == pytest.approx(3)
    assert mdp.visits(only) == pytest.approx([1, 1])  # 1 at once; ½ + ¼ + … = 1


def test_rock_paper_scissors_by_hand() -> None:
    """Paper against rock: one tie that costs ¼, then α wins every round: −¼ + 0.9 / 0.1 · 1 = 8.75."""
    game = rock_paper_scissors()
    rock, paper = np.tile([1.0, 0.0, 0.0], (3, 1)), np.tile([0.0, 1.0, 0.0], (3, 1))
    assert game.alone(ADVERSARY, rock, game.rewards[ADVERSARY]).value(paper) == pytest.approx(8.75)
    assert game.alone(ADVERSARY, rock, game.rewards[VICTIM]).value(paper) == pytest.approx(-9.25)
    best = game.alone(ADVERSARY, rock, game.difference).optimal_policy()
    np.testing.assert_array_equal(best, paper)


def test_tug_of_war_by_hand() -> None:
    """Pulling alone without slips: middle, right, end, middle, …; after γ² comes 1, every three steps."""
    game = tug_of_war(gamma=0.5, slip=0.0, idle_cost=0.0)
    pulls, rests = np.tile([0.0, 1.0], (5, 1)), np.tile([1.0, 0.0], (5, 1))
    value = game.alone(ADVERSARY, rests, game.rewards[ADVERSARY]).value(pulls)
    assert value == pytest.approx(0.25 / (1 - 0.125))


@given(scenes())
@settings(deadline=None, max_examples=20)
def test_either_side_sees_the_same_game(scene: Scene) -> None:
    game = scene.game
    assert game.transition.sum(-1) == pytest.approx(np.ones(game.transition.shape[:-1]))
    for reward in game.rewards:
        mine = game.alone(ADVERSARY, scene.victim, reward)
        theirs = game.alone(VICTIM, scene.adversary, reward)
        assert mine.value(scene.adversary) == pytest.approx(theirs.value(scene.victim))
        occupancy = mine.occupancy(scene.adversary)
        assert occupancy.sum() == pytest.approx(1 / (1 - game.gamma))
        assert (occupancy * mine.reward).sum() == pytest.approx(mine.value(scene.adversary))


@given(scenes())
@settings(deadline=None, max_examples=20)
def test_no_deterministic_policy_beats_the_optimal_one(scene: Scene) -> None:
    faced = scene.game.alone(ADVERSARY, scene.victim, scene.game.difference)
    states, actions = faced.reward.shape
    best = faced.values(faced.optimal_policy())
    choices = list(itertools.product(range(actions), repeat=states))
    for choice in scene.rng.permutation(choices)[:50]:
        assert (faced.values(np.eye(actions)[choice]) <= best + 1e-9 * (1 + np.abs(best).max())).all()


def test_kl_by_hand() -> None:
    """½ log₂ (½ / ¼) + ½ log₂ (½ / ¾) = ½ − ½ log₂ 1.5."""
    bits = kl_bits(np.array([[0.5, 0.5], [1.0, 0.0]]), np.array([[0.25, 0.75], [0.0, 1.0]]))
    assert bits[0] == pytest.approx(0.5 - 0.5 * math.log2(1.5))
    assert bits[1] == math.inf


@given(st.integers(0, 2**32 - 1), st.integers(2, 6), st.sampled_from([0.02, 0.3, 3.0]))
@settings(deadline=None, max_examples=50)
def test_pinsker_in_bits(seed: int, actions: int, spread: float) -> None:
    rng = np.random.default_rng(seed)
    p, q = (random_policy(rng, 20, actions, spread) for _ in range(2))
    # KL is rounded at 1e-16, and its root at 1e-8
    assert (np.abs(p - q).sum(1) <= PINSKER * np.sqrt(kl_bits(p, q)) + 1e-7).all()


def test_pinskers_constant_cannot_be_smaller() -> None:
    p, q = np.array([[0.5, 0.5]]), np.array([[0.501, 0.499]])
    assert np.abs(p - q).sum() > 0.99999 * PINSKER * math.sqrt(kl_bits(p, q)[0])


@given(scenes(most_bits=0.5))
@settings(deadline=None, max_examples=20)
def test_policies_at_a_distance(scene: Scene) -> None:
    towards = np.eye(scene.game.actions(ADVERSARY))[scene.adversary.argmin(1)]
    moved = at_distance(scene.adversary, towards, 0.3)
    assert moved.sum(1) == pytest.approx(np.ones(len(moved)))
    assert kl_bits(scene.adversary, moved) == pytest.approx(np.full(len(moved), 0.3))
