"""E-APIL's imitation problem, solved exactly: max over π̃ of min over D, with D in [D^L, D^U].

For an adversary π^α and a victim π^ν, both fixed,

    J(π̃) = min_D  E_π̃[Σ γ^t log D(s, ã)] + E_π^ν[Σ γ^t log(1 − D(s, a))] − β V_α(π̃, π^α)

where π̃ plays the victim's seat in the first and the last term. In D it is a sum over pairs of
x log D + y log(1 − D) with x, y ≥ 0: concave, so the least value lies at an end of the range. That
makes J a concave, piecewise linear function of π̃'s occupancy, and its maximum a linear programme.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import coo_array, eye_array, hstack, vstack

from .games import ADVERSARY, VICTIM, TabularGame
from .mdp import MDP


@dataclass(frozen=True)
class Imitation:
    """The imitator's problem.

    Attributes:
        game: the game.
        victim: π^ν, (S, B).
        adversary: π^α, (S, A).
        low, high: D^L and D^U, 0 < D^L ≤ D^U < 1. Tanh on the logit gives 0.269 and 0.731.
        beta: weight of −V_α; 0 is APIL.
    """

    game: TabularGame
    victim: np.ndarray
    adversary: np.ndarray
    low: float = 1 / (1 + math.e)
    high: float = math.e / (1 + math.e)
    beta: float = 1.0

    def value(self, imitator: np.ndarray) -> float:
        """J(π̃), π̃ of shape (S, B)."""
        seat = self._seat()
        return self._of_occupancy(seat.occupancy(imitator))

    def discriminator(self, imitator: np.ndarray) -> np.ndarray:
        """A minimising D for that imitator, (S, B); each entry is D^L or D^U."""
        low, high = self._ends(self._seat().occupancy(imitator))
        return np.where(low <= high, self.low, self.high)

    def value_against(self, imitator: np.ndarray, discriminator: np.ndarray) -> float:
        """The objective under a given D, (S, B); J is its minimum over D."""
        seat = self._seat()
        imitated, shown = seat.occupancy(imitator), seat.occupancy(self.victim)
        imitation = imitated * np.log(discriminator) + shown * np.log(1 - discriminator)
        return float(imitation.sum() - self.beta * imitated.sum(1) @ self.game.rewards[ADVERSARY])

    def solve(self) -> tuple[np.ndarray, float]:
        """A maximising imitator (S, B), and its J.

        The programme: maximise Σ z − β Σ ρ r^α over occupancies ρ ≥ 0 and free z, where ρ obeys the flow
        of visits and each z lies below its pair's two terms.
        """
        game, seat = self.game, self._seat()
        states, actions = self.victim.shape
        pairs = states * actions
        shown = seat.occupancy(self.victim).ravel()
        unit = eye_array(pairs)
        ends = (self.low, self.high)
        below = vstack([hstack([-math.log(end) * unit, unit]) for end in ends])
        room = np.concatenate([math.log(1 - end) * shown for end in ends])
        leaving = np.repeat(np.eye(states), actions, axis=1)
        flow = leaving - game.gamma * seat.transition.reshape(pairs, states).T
        cost = np.repeat(self.beta * game.rewards[ADVERSARY], actions)
        found = linprog(
            np.concatenate([cost, -np.ones(pairs)]),
            A_ub=below,
            b_ub=room,
            A_eq=hstack([coo_array(flow), coo_array((states, pairs))]),
            b_eq=game.start,
            bounds=[(0, None)] * pairs + [(None, None)] * pairs,
            method="highs",
        )
        if not found.success:
            raise ArithmeticError(f"the imitator's linear programme: {found.message}")
        occupancy = np.maximum(found.x[:pairs].reshape(states, actions), 0.0)
        visits = occupancy.sum(1, keepdims=True)
        # a state that is never visited: its actions do not matter
        imitator = np.where(visits > 0, occupancy / np.where(visits > 0, visits, 1), 1 / actions)
        return imitator, -float(found.fun)

    def _seat(self) -> MDP:
        return self.game.alone(VICTIM, self.adversary, np.zeros(len(self.game.start)))

    def _ends(self, imitated: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The objective's terms in D at both ends of the range, each (S, B)."""
        shown = self._seat().occupancy(self.victim)
        low, high = (imitated * math.log(end) + shown * math.log(1 - end) for end in (self.low, self.high))
        return low, high

    def _of_occupancy(self, imitated: np.ndarray) -> float:
        least = np.minimum(*self._ends(imitated)).sum()
        return float(least - self.beta * imitated.sum(1) @ self.game.rewards[ADVERSARY])
