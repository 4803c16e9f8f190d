"""The three bounds against exact gaps: errors in the printed statements, and tightness."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from players import Scene, scenes

from apil_core.studies.theory.bounds import informative_kl, lemma_bound
from apil_theory.bounds import (
    imitation_constant,
    lemma_bound_of_mean,
    lemma_bound_of_visits,
    other_adversary_bound,
    unfixed_victim_bound,
)
from apil_theory.comparisons import moved_victim, other_adversary, transferred_imitator
from apil_theory.games import ADVERSARY, VICTIM, TabularGame, coin
from apil_theory.imitation import Imitation
from apil_theory.policies import kl_bits
from apil_theory.survey import survey


def test_formulas_by_hand() -> None:
    """√(2 ln 2) = 1.17741; γ / (1 − γ) = 1 and 1 / (1 − γ) = 2 at γ = ½."""
    assert lemma_bound(3, 0.25, 0.5) == pytest.approx(3 * 1.1774100 * 0.5)
    assert unfixed_victim_bound(3, 0.25, 0.5) == pytest.approx(2 * 3 * 1.1774100 * 0.5)
    constant = imitation_constant(3, 0.5, 0.5, 0.5)
    assert constant == pytest.approx(2 * 1.1774100 * (3 + 2 * math.log(2)))
    assert other_adversary_bound(constant, 0.25) == pytest.approx(constant)
    limit = informative_kl(0.99)
    assert lemma_bound(7, limit, 0.99) == pytest.approx(14)
    assert limit * math.log(2) == pytest.approx(2 * (0.01 / 0.99) ** 2)  # in nats


# --- they hold


@given(scenes())
@settings(deadline=None, max_examples=40)
def test_lemma_and_its_finer_forms(scene: Scene) -> None:
    players = (scene.game, scene.victim, scene.adversary, scene.moved_adversary)
    printed, mean, visits = (other_adversary(*players, form) for form in ("printed", "mean", "visits"))
    assert visits.holds
    assert visits.bound <= mean.bound * (1 + 1e-9) <= printed.bound * (1 + 1e-8)


@given(scenes())
@settings(deadline=None, max_examples=20)
def test_the_lemma_holds_either_way_round(scene: Scene) -> None:
    """H of either adversary, and KL in either order."""
    game, old, new = scene.game, scene.adversary, scene.moved_adversary
    faced = game.alone(ADVERSARY, scene.victim, game.rewards[VICTIM])
    gap = abs(faced.value(new) - faced.value(old))
    for largest in (np.abs(faced.values(policy)).max() for policy in (old, new)):
        for bits in (kl_bits(old, new), kl_bits(new, old)):
            assert gap <= lemma_bound(largest, bits.max(), game.gamma) * (1 + 1e-9) + 1e-9


@given(scenes())
@settings(deadline=None, max_examples=30)
def test_theorem_of_the_unfixed_victim(scene: Scene) -> None:
    assert moved_victim(scene.game, scene.victim, scene.moved_victim).holds


@given(scenes())
@settings(deadline=None, max_examples=15)
def test_theorem_of_the_imitator_under_another_adversary(scene: Scene) -> None:
    asked = Imitation(scene.game, scene.victim, scene.adversary, beta=float(scene.rng.choice([0.0, 1.0])))
    comparison = transferred_imitator(asked, scene.moved_adversary)
    assert comparison.holds
    assert comparison.gap >= -1e-6 * (1 + comparison.bound)


# --- and say something


def test_the_lemma_is_tight() -> None:
    """α chooses the next of two states, worth ±1: Γ changes by γ / (1 − γ) · 2δ, and so does the bound."""
    game, delta = coin(), 1e-4
    fair = np.full((2, 2), 0.5)
    tilted = fair + delta * np.array([-1.0, 1.0])
    comparison = other_adversary(game, np.ones((2, 1)), fair, tilted)
    assert comparison.gap == pytest.approx(9 * 2 * delta)
    assert comparison.holds
    assert comparison.ratio > 0.998


def pennies(adversary: tuple[float, float], victim: tuple[float, float], gamma: float = 0.5) -> TabularGame:
    """Two states, "same" and "different": both players' last actions. Rewards of either side, per state."""
    transition = np.zeros((2, 2, 2, 2))
    for mine in range(2):
        for theirs in range(2):
            transition[:, mine, theirs, int(mine != theirs)] = 1.0
    return TabularGame(transition, np.array([adversary, victim]), np.array([0.5, 0.5]), gamma)


def turned_imitator(game: TabularGame, reward_term: float | None = None):
    """The adversary prefers its first action, then its second; the best imitator has to change with it."""
    fair = np.full((2, 2), 0.5)
    lean = 0.05 * np.array([1.0, -1.0])
    return transferred_imitator(Imitation(game, fair, fair + lean), fair - lean, reward_term)


def test_the_printed_k_is_wrong_max_of_the_victims_reward() -> None:
    """r^α = (R, 0), r^ν = −r^α: a zero-sum game in which max r^ν is 0, and the loss grows with R."""
    game = pennies((1000.0, 0.0), (-1000.0, 0.0))
    printed = turned_imitator(game, float(game.rewards[VICTIM].max()))
    assert printed.gap > 10 * printed.bound > 0
    assert turned_imitator(game).holds


def test_the_proofs_k_needs_the_absolute_value() -> None:
    """r^α = (0, −R): max r^α is 0."""
    game = pennies((0.0, -1000.0), (0.0, 1000.0))
    without = turned_imitator(game, float(game.rewards[ADVERSARY].max()))
    assert without.gap > 10 * without.bound > 0
    assert turned_imitator(game).holds


def test_without_it_k_can_even_be_negative() -> None:
    game = pennies((-5.0, -6.0), (-5.0, -6.0))
    for reward in game.rewards:
        assert turned_imitator(game, float(reward.max())).bound < 0
    assert turned_imitator(game).holds


def test_rewards_of_actions_break_the_lemma() -> None:
    """The theorems need rewards of the state alone: here the action has the reward, and no later state."""
    bits = 0.1
    fair = np.array([0.5, 0.5])
    tilted = np.array([0.5, 0.5]) + np.array([-1, 1]) * 0.18
    pays = np.array([-1.0, 1.0])
    gap, largest, gamma = (tilted - fair) @ pays, tilted @ pays, 0.1
    assert kl_bits(fair[None], tilted[None])[0] < 2 * bits
    assert gap / (1 - gamma) > lemma_bound(largest / (1 - gamma), 2 * bits, gamma)


def test_nats_taken_for_bits_would_break_it() -> None:
    """The factor √(2 ln 2) belongs to bits: with KL in nats the constant is √2."""
    game, delta = coin(), 1e-4
    fair = np.full((2, 2), 0.5)
    tilted = fair + delta * np.array([-1.0, 1.0])
    true = other_adversary(game, np.ones((2, 1)), fair, tilted)
    assert true.gap > true.bound * math.sqrt(math.log(2))


def test_finer_forms_are_the_same_formula() -> None:
    assert lemma_bound_of_mean(2, 0.3, 0.9) == lemma_bound(2, 0.3, 0.9)
    assert lemma_bound_of_visits(2, 10 * math.sqrt(0.3), 0.9) == pytest.approx(lemma_bound(2, 0.3, 0.9))


def test_the_survey_of_the_docs() -> None:
    rows = list(survey(draws=2, seed=1))
    assert len(rows) == 15
    assert all(row.violations == 0 and 0 <= row.median <= row.largest < 1 for row in rows)
