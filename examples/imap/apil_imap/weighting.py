"""Bias reduction: how much the intrinsic advantage weighs (IMAP's BR)."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from apil_imap.config import ImapConfig


def expected_objective(last: float, growth: float, ceiling: float = float("inf")) -> float:
    """What the objective should come to: ``growth`` times better than ``last``, at most ``ceiling``.

    A negative objective gets better by getting smaller in size, so it is divided.
    """
    return min(last * growth if last > 0 else last / growth, ceiling)


def next_multiplier(multiplier: float, objective: float, expected: float, rate: float) -> float:
    """λ ← max(λ − rate·(objective − expected), 0): dual ascent for the constraint objective ≥ expected."""
    return max(multiplier - rate * (objective - expected), 0.0)


def temperature(tau: float, multiplier: float) -> float:
    """τ_k = τ / (1 + λ_k): max J_E + τ J_I s.t. J_E ≥ J̄ has the Lagrangian (1 + λ) J_E + τ J_I."""
    return tau / (1.0 + multiplier)


class BiasReduction(nn.Module):
    """λ from iteration to iteration. Its numbers are buffers, so that several processes agree on them.

    Args:
        options: IMAP's.
    """

    multiplier: Tensor
    last: Tensor
    updates: Tensor

    def __init__(self, options: ImapConfig):
        super().__init__()
        self.options = options
        self.register_buffer("multiplier", torch.zeros((), dtype=torch.float64))
        self.register_buffer("last", torch.zeros((), dtype=torch.float64))
        self.register_buffer("updates", torch.zeros((), dtype=torch.long))

    def update(self, objective: float) -> None:
        """Take in this iteration's objective; the first one has nothing to be compared with."""
        options = self.options
        if self.updates:
            ceiling = 1.0 if options.objective == "win_rate" else float("inf")
            expected = expected_objective(float(self.last), options.expected_growth, ceiling)
            step = next_multiplier(float(self.multiplier), objective, expected, options.multiplier_rate)
            self.multiplier.fill_(step)
        self.last.fill_(objective)
        self.updates.add_(1)

    @property
    def weight(self) -> float:
        """τ_k."""
        if not self.options.bias_reduction:
            return self.options.tau
        return temperature(self.options.tau, float(self.multiplier))
