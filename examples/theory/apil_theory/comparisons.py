"""Each bound with the exact gap it bounds, on a tabular game."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from apil_core.studies.theory.bounds import lemma_bound

from .bounds import (
    imitation_constant,
    lemma_bound_of_mean,
    lemma_bound_of_visits,
    other_adversary_bound,
    unfixed_victim_bound,
)
from .games import ADVERSARY, VICTIM, TabularGame
from .imitation import Imitation
from .policies import kl_bits

LemmaForm = Literal["printed", "mean", "visits"]


@dataclass(frozen=True)
class Comparison:
    """A bound and the quantity it bounds.

    Attributes:
        gap: exact, not negative (up to rounding).
        bound: the theorem's upper bound on the gap.
    """

    gap: float
    bound: float

    @property
    def holds(self) -> bool:
        """True if the gap does not exceed the bound, up to rounding of linear solves and programmes."""
        return self.gap <= self.bound + 1e-7 * (1 + abs(self.bound))

    @property
    def ratio(self) -> float:
        """Gap over bound: 1 is tight, 0 says nothing; NaN where there is nothing to bound."""
        return self.gap / self.bound if self.bound > 0 else float("nan")


def other_adversary(
    game: TabularGame, victim: np.ndarray, old: np.ndarray, new: np.ndarray, form: LemmaForm = "printed"
) -> Comparison:
    """The Lemma: the victim's value under two adversaries, each (S, A).

    Args:
        form: with the largest KL over states, with its mean over the old adversary's visits, or with its
            root summed over these visits; each is sharper than the one before.
    """
    before = game.alone(ADVERSARY, victim, game.rewards[VICTIM])
    gap = abs(before.value(new) - before.value(old))
    divergence, visits = kl_bits(old, new), before.visits(old)
    largest, gamma = float(np.abs(before.values(new)).max()), game.gamma
    if form == "printed":
        return Comparison(gap, lemma_bound(largest, float(divergence.max()), gamma))
    if form == "mean":
        return Comparison(gap, lemma_bound_of_mean(largest, (1 - gamma) * float(visits @ divergence), gamma))
    return Comparison(gap, lemma_bound_of_visits(largest, float(visits @ np.sqrt(divergence)), gamma))


def moved_victim(game: TabularGame, victim: np.ndarray, moved: np.ndarray) -> Comparison:
    """Theorem (unfixed victim): the best difference of values against two victims, each (S, B)."""
    best = []
    for policy in (victim, moved):
        faced = game.alone(ADVERSARY, policy, game.difference)
        best.append(faced.value(faced.optimal_policy()))
    epsilon = float(kl_bits(victim, moved).max())
    bound = unfixed_victim_bound(float(np.abs(game.difference).max()), epsilon, game.gamma)
    return Comparison(abs(best[1] - best[0]), bound)


def transferred_imitator(problem: Imitation, new: np.ndarray, reward_term: float | None = None) -> Comparison:
    """Theorem (imitator under another adversary): the best imitator for one, used under the other.

    Args:
        problem: with the adversary that the imitator is made for.
        new: the adversary it is used under, (S, A).
        reward_term: in K; default: β max_s |r^α(s)|, the one that is right.
    """
    game = problem.game
    other = Imitation(game, problem.victim, new, problem.low, problem.high, problem.beta)
    kept, _ = problem.solve()
    _, best = other.solve()
    if reward_term is None:
        reward_term = problem.beta * float(np.abs(game.rewards[ADVERSARY]).max())
    constant = imitation_constant(reward_term, problem.low, problem.high, game.gamma)
    largest = float(kl_bits(problem.adversary, new).max())
    return Comparison(best - other.value(kept), other_adversary_bound(constant, largest))
