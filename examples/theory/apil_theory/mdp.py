"""Finite discounted decision problems, solved exactly by linear algebra."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

_ROUNDS = 1000
"""Maximum rounds of policy iteration, which usually converges in a few."""


@dataclass(frozen=True)
class MDP:
    """The decision problem of a single learner. S states, A actions.

    Attributes:
        transition: (S, A, S), rows sum to 1.
        reward: (S, A).
        start: (S,), distribution of the first state.
        gamma: discount per step, in [0, 1).
    """

    transition: np.ndarray
    reward: np.ndarray
    start: np.ndarray
    gamma: float

    def values(self, policy: np.ndarray) -> np.ndarray:
        """V(s) = E[Σ_t γ^t r(s_t, a_t) | s_0 = s] under ``policy`` (S, A); shape (S,)."""
        return np.linalg.solve(self._system(policy), (policy * self.reward).sum(1))

    def value(self, policy: np.ndarray) -> float:
        """V averaged over the initial state; complex if ``policy`` is (see :mod:`.gradients`)."""
        value: float = self.start @ self.values(policy)
        return value

    def action_values(self, policy: np.ndarray) -> np.ndarray:
        """Q(s, a), shape (S, A)."""
        values: np.ndarray = self.reward + self.gamma * self.transition @ self.values(policy)
        return values

    def visits(self, policy: np.ndarray) -> np.ndarray:
        """Discounted visits Σ_t γ^t P(s_t = s), shape (S,); they sum to 1 / (1 − γ)."""
        return np.linalg.solve(self._system(policy).T, self.start)

    def occupancy(self, policy: np.ndarray) -> np.ndarray:
        """Discounted visits of pairs, Σ_t γ^t P(s_t = s, a_t = a), shape (S, A)."""
        return self.visits(policy)[:, None] * policy

    def optimal_policy(self) -> np.ndarray:
        """A deterministic policy of largest value from every state, (S, A), by policy iteration."""
        rows = np.arange(len(self.reward))
        choice = self.reward.argmax(1)
        for _ in range(_ROUNDS):
            policy = np.eye(self.reward.shape[1])[choice]
            gains = self.action_values(policy)
            best = gains.argmax(1)
            # ties must not make it cycle
            better = gains[rows, best] > gains[rows, choice] + 1e-12 * (1 + np.abs(gains).max())
            if not better.any():
                return policy
            choice = np.where(better, best, choice)
        raise ArithmeticError("policy iteration did not settle")

    def _system(self, policy: np.ndarray) -> np.ndarray:
        steps = np.einsum("sa,sat->st", policy, self.transition)
        return np.eye(len(self.start)) - self.gamma * steps
