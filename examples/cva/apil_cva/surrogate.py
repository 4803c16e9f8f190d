"""The surrogate of the victim's value function."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor, nn

from apil_core import mlp
from apil_cva.config import SurrogateConfig
from apil_cva.training import ADAM_EPSILON, descend, minibatches


class Surrogate(nn.Module):
    """V̂_ν: predicts the victim's discounted return from what the attacker can see.

    Args:
        input_size: length of the normalised observation it reads.
        config: layers and training.
        device: of the network.
    """

    def __init__(self, input_size: int, config: SurrogateConfig, device: torch.device):
        super().__init__()
        self.config = config
        self.network = mlp((input_size, *config.hidden, 1)).to(device)
        self.optimizer = torch.optim.Adam(self.network.parameters(), config.learning_rate, eps=ADAM_EPSILON)

    @torch.no_grad()
    def look(self, states: Tensor) -> tuple[Tensor, Tensor]:
        """Last hidden layer (..., h) and value (...,) for normalised observations (..., o)."""
        hidden = self.network[:-1](states)
        return hidden, self.network[-1](hidden)[..., 0]

    def learn(self, states: Tensor, targets: Tensor, parts: int, generator: torch.Generator) -> float:
        """Train for some epochs with mean squared error on (m, o) and returns (m,); return the mean loss.

        Args:
            states: normalised observations.
            targets: the victim's estimated returns.
            parts: minibatches per epoch.
            generator: of their order.
        """
        losses = []
        for rows in minibatches(len(states), parts, self.config.epochs, generator):
            values = self.network(states.index_select(0, rows))[:, 0]
            loss = (values - targets[rows]).square().mean()
            losses.append(descend(loss, self.network, self.optimizer))
        return float(torch.stack(losses).mean())

    def training_state(self) -> dict[str, Any]:
        """Return network and optimiser."""
        return {"network": self.network.state_dict(), "optimizer": self.optimizer.state_dict()}

    def load_training_state(self, state: dict[str, Any]) -> None:
        """Restore what :meth:`training_state` returned."""
        self.network.load_state_dict(state["network"])
        self.optimizer.load_state_dict(state["optimizer"])
