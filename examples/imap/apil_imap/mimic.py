"""The network that follows the adversary's past policies (IMAP's D)."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor, nn

from apil_core import DiagonalGaussian, GaussianActor
from apil_imap.config import MimicConfig

_ADAM_EPSILON = 1e-5


class Mimic(nn.Module):
    """A policy that descends KL(π_k ‖ mimic) a little on every rollout, so that it lags behind.

    Args:
        observation_size, action_size: of the adversary.
        config: its options.
        init_std: the adversary's before training, so that the first divergence is near 0.
    """

    def __init__(self, observation_size: int, action_size: int, config: MimicConfig, init_std: float):
        super().__init__()
        self.config = config
        self.policy = GaussianActor(observation_size, action_size, config.hidden, init_std)
        self.optimizer = torch.optim.Adam(self.policy.parameters(), config.learning_rate, eps=_ADAM_EPSILON)

    def divergence(self, acted: DiagonalGaussian, states: Tensor) -> Tensor:
        """KL(π_k ‖ mimic) in nats, (…,), for normalised observations (…, o)."""
        return acted.kl(self.policy(states))

    def learn(self, acted: DiagonalGaussian, states: Tensor, generator: torch.Generator) -> float:
        """Train some passes over one rollout, flattened to (m, …); return the mean over their steps."""
        losses = []
        for _ in range(self.config.epochs):
            order = torch.randperm(len(states), generator=generator, device=generator.device)
            for rows in order.chunk(self.config.minibatches):
                part = DiagonalGaussian(acted.mean[rows], acted.std[rows])
                loss = self.divergence(part, states[rows]).mean()
                self.optimizer.zero_grad()
                loss.backward()
                nn.utils.clip_grad_norm_(self.policy.parameters(), self.config.max_grad_norm)
                self.optimizer.step()
                losses.append(loss.detach())
        return float(torch.stack(losses).mean())

    def training_state(self) -> dict[str, Any]:
        """Return weights and optimiser."""
        return {"policy": self.policy.state_dict(), "optimizer": self.optimizer.state_dict()}

    def load_training_state(self, state: dict[str, Any]) -> None:
        """Restore what :meth:`training_state` returned."""
        self.policy.load_state_dict(state["policy"])
        self.optimizer.load_state_dict(state["optimizer"])
