"""Pure functions of rewards and values: generalised advantage estimation and its normalisation."""

from __future__ import annotations

import torch
from torch import Tensor


def gae(
    rewards: Tensor, values: Tensor, next_value: Tensor, done: Tensor, *, gamma: float, lam: float
) -> Tensor:
    """Generalised advantage estimation (Schulman et al. 2016, eq. 16), truncated at game ends.

        δ_t = r_t + γ (1 − done_t) V_{t+1} − V_t
        A_t = δ_t + γ λ (1 − done_t) A_{t+1}

    A time-out is an outcome of these games, so a done step is never bootstrapped.

    Args:
        rewards: shape (T, n).
        values: V(s_t), shape (T, n).
        next_value: V after the last step, shape (n,).
        done: shape (T, n), bool.
        gamma: discount per step.
        lam: λ.

    Returns:
        advantages, shape (T, n); add ``values`` for the critic's targets.
    """
    advantages = torch.empty_like(rewards)
    going_on = 1.0 - done.to(rewards.dtype)
    following = torch.cat([values[1:], next_value.unsqueeze(0)])
    deltas = rewards + gamma * going_on * following - values
    decay = gamma * lam * going_on
    running = torch.zeros_like(next_value)
    for t in range(rewards.shape[0] - 1, -1, -1):
        running = torch.addcmul(deltas[t], decay[t], running, out=advantages[t])
    return advantages


def normalize_advantages(advantages: Tensor) -> Tensor:
    """Shift to mean 0 and scale to standard deviation 1 over all entries; shape unchanged."""
    return (advantages - advantages.mean()) / (advantages.std() + 1e-8)
