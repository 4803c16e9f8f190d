"""The victim's network in training: the same sums as the policy it was made from, with gradients."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from apil_core.policies.student_policy import StudentShape, Weights
from apil_core.runs.distillation.learner import Memory, StudentNetwork

_STATISTICS = ("observation.mean", "observation.std")


class Standardiser(nn.Module):
    """``clip((x − mean) / std, ±clip)`` by the statistics the victim was trained with; they stay as they are.

    Moving them would change what the victim does without any gradient asking for it.
    """

    mean: Tensor
    std: Tensor

    def __init__(self, shape: StudentShape, weights: Weights):
        super().__init__()
        self.clip = shape.clip
        for name in _STATISTICS:
            self.register_buffer(name.rpartition(".")[2], weights[name].clone())

    def forward(self, observation: Tensor) -> Tensor:
        """(..., o) → (..., o)."""
        return ((observation - self.mean) / self.std).clamp_(-self.clip, self.clip)


class VictimNetwork(nn.Module):
    """A victim that can be trained: standardised observation → body → mean action, and a log-std of its own.

    Attributes:
        body: from standardised observations to mean actions.
        log_std: of the actions, (a,), trained like the weights.

    Args:
        shape: see :class:`StudentShape`.
        weights: tensors as :meth:`StudentShape.tensors` names them.
    """

    def __init__(self, shape: StudentShape, weights: Weights):
        super().__init__()
        self.shape = shape
        self.standardise = Standardiser(shape, weights)
        self.body = body_of(shape, weights)
        self.log_std = nn.Parameter(weights["log_std"].clone())

    @property
    def recurrent(self) -> bool:
        """Whether it remembers."""
        return self.shape.kind == "lstm"

    def forward(self, z: Tensor, done: Tensor, memory: Memory) -> tuple[Tensor, Memory]:
        """Mean actions of a stretch of steps; see :meth:`StudentNetwork.forward`."""
        mean, memory = self.body(z, done, memory)
        return mean, memory

    def weights(self) -> dict[str, Tensor]:
        """All tensors as a student's file has them, on the CPU."""
        statistics = {"observation.mean": self.standardise.mean, "observation.std": self.standardise.std}
        found = {**statistics, "log_std": self.log_std.detach(), **self.body.state_dict()}
        return {name: tensor.detach().cpu().clone() for name, tensor in found.items()}


def body_of(shape: StudentShape, weights: Weights) -> StudentNetwork:
    """The layers between standardised observation and output, with those weights."""
    with torch.random.fork_rng(devices=[]):  # initial weights are drawn and thrown away
        network = StudentNetwork(shape)
    network.load_state_dict({name: weights[name] for name in network.state_dict()})
    return network
