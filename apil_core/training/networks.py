"""The small networks methods are made of: tanh MLPs with orthogonal initial weights."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import torch
from torch import Tensor, nn

from apil_core.api.types import DiagonalGaussian


def mlp(sizes: Sequence[int], *, output_gain: float = 1.0) -> nn.Sequential:
    """Linear layers of the given sizes with tanh between them.

    Weights are orthogonal with gain √2 (hidden) and ``output_gain`` (last), biases zero: the
    initialisation of the PPO code all four methods were published with.
    """
    layers: list[nn.Module] = []
    for i, (inputs, outputs) in enumerate(itertools.pairwise(sizes)):
        last = i == len(sizes) - 2
        linear = nn.Linear(inputs, outputs)
        nn.init.orthogonal_(linear.weight, gain=output_gain if last else math.sqrt(2))
        nn.init.zeros_(linear.bias)
        layers.append(linear)
        if not last:
            layers.append(nn.Tanh())
    return nn.Sequential(*layers)


class GaussianActor(nn.Module):
    """A Gaussian policy: tanh MLP for the mean, state-independent log standard deviation.

    Args:
        observation_size, action_size: of the policy.
        hidden: sizes of the hidden layers.
        init_std: standard deviation before training.
    """

    def __init__(
        self, observation_size: int, action_size: int, hidden: Sequence[int] = (64, 64), init_std: float = 1.0
    ):
        super().__init__()
        self.body = mlp((observation_size, *hidden, action_size), output_gain=0.01)
        self.log_std = nn.Parameter(torch.full((action_size,), math.log(init_std)))

    def forward(self, observation: Tensor) -> DiagonalGaussian:
        """Distribution of the action for observations of shape (..., observation_size)."""
        return DiagonalGaussian(self.body(observation), self.log_std.exp())
