"""The two gradient identities of docs/methods.md, both sides computed independently.

§1: ∇_θ (V_α − V_ν) is the policy gradient with reward Δr.
§2: the gradient of E-APIL's objective E_π̃[Σ γ^t log D] − β V_α with respect to the imitator is the policy
gradient with reward log D − β r^α.

The right-hand side is :func:`enumerated_gradient`, the formula as printed, over every trajectory of a short
game, or :func:`policy_gradient`, its closed form without an end. The left-hand side is
:func:`derivative` of a value computed without policy gradients.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from .mdp import MDP
from .policies import softmax

_STEP = 1e-30


def derivative(value: Callable[[np.ndarray], complex], logits: np.ndarray) -> np.ndarray:
    """∂ value(softmax(logits)) / ∂ logits, shape as ``logits``.

    By complex steps, Im f(x + ih) / h: finite differences without cancellation, exact to rounding.

    Args:
        value: analytic function of a policy (S, A).
        logits: (S, A).
    """
    result = np.empty(logits.shape)
    for place in np.ndindex(logits.shape):
        shifted = logits.astype(complex)
        shifted[place] += 1j * _STEP
        result[place] = complex(value(softmax(shifted))).imag / _STEP
    return result


def policy_gradient(mdp: MDP, logits: np.ndarray) -> np.ndarray:
    """Σ_s Σ_t γ^t P(s_t = s) Σ_a π(a|s) Q(s, a) ∇ log π(a|s), shape (S, A)."""
    policy = softmax(logits)
    values = mdp.action_values(policy)
    advantages = values - (policy * values).sum(1, keepdims=True)
    gradient: np.ndarray = mdp.occupancy(policy) * advantages
    return gradient


def enumerated_gradient(mdp: MDP, logits: np.ndarray, horizon: int) -> np.ndarray:
    """E[Σ_t γ^t r(s_t, a_t) · Σ_t ∇ log π(a_t|s_t)] over all trajectories of ``horizon`` steps, (S, A)."""
    policy = softmax(logits)
    total = np.zeros(logits.shape)
    for probability, taken in _trajectories(mdp, policy, horizon):
        rewards = sum(mdp.gamma**t * mdp.reward[pair] for t, pair in enumerate(taken))
        scores = np.zeros(logits.shape)
        for state, action in taken:
            scores[state] -= policy[state]
            scores[state, action] += 1.0
        total += probability * rewards * scores
    return total


def finite_value(mdp: MDP, policy: np.ndarray, horizon: int) -> complex:
    """E[Σ_{t < horizon} γ^t r(s_t, a_t)], by stepping the distribution of states."""
    reach, total = mdp.start, 0j
    for t in range(horizon):
        total += mdp.gamma**t * (reach @ (policy * mdp.reward).sum(1))
        reach = np.einsum("s,sa,sat->t", reach, policy, mdp.transition)
    return total


def _trajectories(
    mdp: MDP, policy: np.ndarray, horizon: int
) -> Iterator[tuple[float, tuple[tuple[int, int], ...]]]:
    """Probability and (state, action) pairs of every possible trajectory of ``horizon`` steps."""

    def on(
        state: int, probability: float, past: tuple[tuple[int, int], ...]
    ) -> Iterator[tuple[float, tuple[tuple[int, int], ...]]]:
        for action in range(policy.shape[1]):
            taken, here = (*past, (state, action)), probability * float(policy[state, action])
            if len(taken) == horizon:
                yield here, taken
                continue
            for following in np.flatnonzero(mdp.transition[state, action]).tolist():
                yield from on(following, here * float(mdp.transition[state, action, following]), taken)

    for first in np.flatnonzero(mdp.start).tolist():
        yield from on(first, float(mdp.start[first]), ())
