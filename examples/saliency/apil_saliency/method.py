"""The method: the gradient of the victim's action in its view of the opponent is part of the reward."""

from __future__ import annotations

import torch
from torch import Tensor

from apil_core import Method, Rollout, Run, hookimpl
from apil_saliency.config import SaliencyConfig


class Saliency(Method):
    """r'_t = r_t + λ ‖∂ Σ_j |μ_j / σ_j| / ∂ (s^ν_t's opponent channels)‖, μ and σ of the victim's actions."""

    options: SaliencyConfig
    last = 0.0

    @hookimpl
    def relabel_reward(self, run: Run, rollout: Rollout, reward: Tensor) -> Tensor:
        """Add the weighted sensitivity, (T, n)."""
        seen = rollout.victim_observation.clone().requires_grad_()
        acted = run.victim.replay(rollout, seen).distribution
        assert acted is not None  # white-box victims have one
        (gradient,) = torch.autograd.grad((acted.mean / acted.std).abs().sum(), seen)
        sensitivity = gradient[..., list(self.setup.victim.opponent_channels)].norm(dim=-1)
        self.last = float(sensitivity.mean())
        return reward + self.options.weight * sensitivity

    @hookimpl
    def update_auxiliary(self) -> dict[str, float]:
        """Log the mean sensitivity."""
        return {"sensitivity": self.last}
