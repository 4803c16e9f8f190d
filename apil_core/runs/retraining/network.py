"""The victim's network in training: the same sums as the policy it was made from, with gradients."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor, nn

from apil_core.policies.network import LstmState, NetworkShape, PolicyNetwork, Standardizer, Weights
from apil_core.training.networks import mlp


class VictimNetwork(nn.Module):
    """A victim that can be trained: standardised observation → body → mean action, and a log-std of its own.

    Attributes:
        body: from standardised observations to mean actions.
        log_std: of the actions, (a,), trained like the weights.

    Args:
        shape: see :class:`NetworkShape`.
        weights: tensors as :meth:`NetworkShape.tensors` names them.
    """

    def __init__(self, shape: NetworkShape, weights: Weights):
        super().__init__()
        self.shape = shape
        self.standardise = Standardizer(weights["observation.mean"], weights["observation.std"], shape.clip)
        self.body = PolicyNetwork.of(shape, _copies(weights))
        self.log_std = nn.Parameter(weights["log_std"].clone())

    @property
    def recurrent(self) -> bool:
        """Whether it remembers."""
        return self.shape.kind == "lstm"

    def forward(self, z: Tensor, done: Tensor, memory: LstmState) -> tuple[Tensor, LstmState]:
        """Mean actions of a stretch of steps; see :meth:`PolicyNetwork.forward`."""
        mean, memory = self.body(z, done, memory)
        return mean, memory

    def weights(self) -> dict[str, Tensor]:
        """All tensors as a student's file has them, on the CPU."""
        statistics = {"observation.mean": self.standardise.mean, "observation.std": self.standardise.std}
        found = {**statistics, "log_std": self.log_std.detach(), **self.body.state_dict()}
        return {name: tensor.detach().cpu().clone() for name, tensor in found.items()}


class Critic(nn.Module):
    """From standardised observations to the discounted return in the learner's normalised units.

    Args:
        shape: of the network; its one action is the value.
        weights: of its layers.
    """

    def __init__(self, shape: NetworkShape, weights: Weights):
        super().__init__()
        self.shape = shape
        self.body: PolicyNetwork = PolicyNetwork.of(shape, _copies(weights))

    @property
    def recurrent(self) -> bool:
        """Whether it remembers."""
        return self.shape.kind == "lstm"

    def forward(self, z: Tensor, done: Tensor, memory: LstmState) -> tuple[Tensor, LstmState]:
        """Values of a stretch of steps, (T, n, o) → (T, n), and the memory after it."""
        value, memory = self.body(z, done, memory)
        return value[..., 0], memory

    @torch.no_grad()
    def rescale(self, factor: float, shift: float = 0.0) -> None:
        """From now on give ``factor · value + shift``: a change of units, folded into the last layer."""
        last = self.body.mlp[-1]
        assert isinstance(last, nn.Linear)
        last.weight.mul_(factor)
        last.bias.mul_(factor).add_(shift)


def new_critic(shape: NetworkShape, hidden: Sequence[int]) -> Critic:
    """A feed-forward critic that reads what the victim reads; torch's global generator draws its weights.

    It has no memory: what it must know of the opponent is in the observation, and a pass through time less
    is a third of an update less.
    """
    own = NetworkShape("mlp", shape.observation_size, 1, 0, tuple(hidden), shape.clip)
    layers = [layer for layer in mlp((shape.observation_size, *hidden, 1)) if isinstance(layer, nn.Linear)]
    weights = {f"mlp.{i}.weight": layer.weight for i, layer in enumerate(layers)}
    weights |= {f"mlp.{i}.bias": layer.bias for i, layer in enumerate(layers)}
    return Critic(own, weights)


def _copies(weights: Weights) -> Weights:
    return {name: tensor.detach().clone() for name, tensor in weights.items()}
