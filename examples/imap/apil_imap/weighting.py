"""Bias reduction: the weight of the intrinsic advantage (IMAP's BR)."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor, nn

from apil_imap.config import ImapConfig


def expected_objective(last: float, growth: float, ceiling: float = float("inf")) -> float:
    """Target of the objective: ``growth`` times better than ``last``, at most ``ceiling``.

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
    """λ from iteration to iteration.

    λ is a buffer, so that several processes agree on it. The last objective is each process's own:
    they end enough games in different iterations, and the mean of an objective and a zero is no goal.

    Args:
        options: IMAP's.
    """

    multiplier: Tensor

    def __init__(self, options: ImapConfig):
        super().__init__()
        self.options = options
        self.register_buffer("multiplier", torch.zeros((), dtype=torch.float64))
        self.last: float | None = None

    def update(self, objective: float) -> None:
        """Update with this iteration's objective; the first one has no predecessor to compare with."""
        options = self.options
        if self.last is not None:
            ceiling = 1.0 if options.objective == "win_rate" else float("inf")
            expected = expected_objective(self.last, options.expected_growth, ceiling)
            step = next_multiplier(float(self.multiplier), objective, expected, options.multiplier_rate)
            self.multiplier.fill_(step)
        self.last = objective

    def training_state(self) -> dict[str, Any]:
        """Return λ and the last objective."""
        return {"multiplier": float(self.multiplier), "last": self.last}

    def load_training_state(self, state: dict[str, Any]) -> None:
        """Restore what :meth:`training_state` returned."""
        self.multiplier.fill_(state["multiplier"])
        self.last = state["last"]

    @property
    def weight(self) -> float:
        """τ_k."""
        if not self.options.bias_reduction:
            return self.options.tau
        return temperature(self.options.tau, float(self.multiplier))
