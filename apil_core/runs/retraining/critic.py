"""The value network of a retraining: the victim's own, or a new one."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor, nn

from apil_core.policies.student_policy import StudentShape, Weights
from apil_core.runs.distillation.learner import Memory, StudentNetwork
from apil_core.runs.retraining.network import body_of
from apil_core.training.networks import mlp


class Critic(nn.Module):
    """From standardised observations to the discounted return in the learner's normalised units.

    Args:
        shape: of the network; its one action is the value.
        weights: of its layers.
    """

    def __init__(self, shape: StudentShape, weights: Weights):
        super().__init__()
        self.shape = shape
        self.body: StudentNetwork = body_of(shape, weights)

    @property
    def recurrent(self) -> bool:
        """Whether it remembers."""
        return self.shape.kind == "lstm"

    def forward(self, z: Tensor, done: Tensor, memory: Memory) -> tuple[Tensor, Memory]:
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


def new_critic(shape: StudentShape, hidden: Sequence[int]) -> Critic:
    """A feed-forward critic that reads what the victim reads; torch's global generator draws its weights.

    It has no memory: what it must know of the opponent is in the observation, and a pass through time less
    is a third of an update less.
    """
    own = StudentShape("mlp", shape.observation_size, 1, 0, tuple(hidden), shape.clip)
    layers = [layer for layer in mlp((shape.observation_size, *hidden, 1)) if isinstance(layer, nn.Linear)]
    weights = {f"mlp.{i}.weight": layer.weight for i, layer in enumerate(layers)}
    weights |= {f"mlp.{i}.bias": layer.bias for i, layer in enumerate(layers)}
    return Critic(own, weights)
