"""The value function of one reward of the imitator."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor, nn

from apil_apil.config import ImitatorConfig
from apil_core import gae, mlp

ADAM_EPSILON = 1e-5


class Critic(nn.Module):
    """V(s) of one reward, a tanh network with its own optimiser.

    Args:
        state_size: length of the (normalised) state.
        config: layers, step size, passes.
    """

    def __init__(self, state_size: int, config: ImitatorConfig):
        super().__init__()
        self.config = config
        self.body = mlp((state_size, *config.hidden, 1))
        self.optimizer = torch.optim.Adam(
            self.body.parameters(), config.value_learning_rate, eps=ADAM_EPSILON, fused=True
        )
        self._targets: Tensor | None = None

    @torch.no_grad()
    def advantages(
        self, states: Tensor, following: Tensor, rewards: Tensor, done: Tensor, *, gamma: float, lam: float
    ) -> Tensor:
        """Compute GAE of ``rewards``, (T, n), and store the targets for :meth:`fit`.

        With γ = 0 it is reward − V(s): V is then a baseline of the immediate reward.

        Args:
            states: (T, n, s).
            following: after the last step, (n, s).
            rewards: (T, n).
            done: (T, n), bool.
            gamma, lam: discount and λ.
        """
        values = self.body(states)[..., 0]
        advantages = gae(rewards, values, self.body(following)[..., 0], done, gamma=gamma, lam=lam)
        self._targets = (advantages + values).flatten()
        return advantages

    def batches(self, count: int, generator: torch.Generator) -> list[Tensor]:
        """Rows of its passes over ``count`` states, for :meth:`fit`."""
        return batches(count, self.config.value_epochs, self.config.minibatches, generator)

    def fit(self, states: Tensor, parts: list[Tensor]) -> float:
        """Least squares on the targets of the last :meth:`advantages`; returns the mean loss.

        Args:
            states: the same, flat: (T·n, s).
            parts: rows of the minibatches, in order.
        """
        assert self._targets is not None
        losses = []
        for rows in parts:
            loss = (self.body(states.index_select(0, rows))[..., 0] - self._targets[rows]).square().mean()
            descend(loss, self.body, self.optimizer, self.config.max_grad_norm)
            losses.append(loss.detach())
        self._targets = None
        return float(torch.stack(losses).mean())

    def training_state(self) -> dict[str, Any]:
        """Weights and optimiser."""
        return {"critic": self.body.state_dict(), "value_optimizer": self.optimizer.state_dict()}

    def load_training_state(self, state: dict[str, Any]) -> None:
        """Restore the result of :meth:`training_state`."""
        self.body.load_state_dict(state["critic"])
        self.optimizer.load_state_dict(state["value_optimizer"])


def batches(count: int, epochs: int, parts: int, generator: torch.Generator) -> list[Tensor]:
    """Row indices of ``epochs`` shuffled passes over ``count`` rows in ``parts`` minibatches each."""
    passes = [torch.randperm(count, generator=generator, device=generator.device) for _ in range(epochs)]
    return [rows for order in passes for rows in order.chunk(parts)]


def descend(loss: Tensor, module: nn.Module, optimizer: torch.optim.Optimizer, max_grad_norm: float) -> None:
    """One optimiser step down ``loss``, the gradient's norm clipped."""
    optimizer.zero_grad()
    loss.backward()
    nn.utils.clip_grad_norm_(module.parameters(), max_grad_norm)
    optimizer.step()
