"""A zoo agent as a policy: tensors in the students' format, floating-point sums in the published order."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from apil_core.api.policy import PolicyInfo
from apil_core.policies.frozen_policy import FrozenPolicy, StoredCritic
from apil_core.policies.network import LstmState, NetworkShape, PolicyNetwork, Standardizer
from apil_core.policies.recurrent_state import State

Tensors = Mapping[str, NDArray[np.float32]]

CLIP = 5.0
"""Bound of the standardised observation."""
_LEAST_VARIANCE = 0.01
_STATE = "actor."
"""Before the names of a recurrent state, as in checkpoints of all versions."""


class ZooPolicy(FrozenPolicy):
    """A frozen agent of Bansal et al. 2018.

    Standardises its observation by the mean and variance of its own training, clips it to ±5, and samples
    from a normal distribution whose standard deviation does not depend on the observation.
    Runs that attacked it must resume bit for bit, so rounding matters: it multiplies by the reciprocal
    of the deviation, and its LSTM multiplies and adds in one ``addcmul``.
    """

    def __init__(self, info: PolicyInfo, tensors: Tensors):
        mean, deviation = _moments(tensors, "observation_filter")
        shape, layers = _layers(tensors, "policy", info.observation_size, info.action_size)
        critic_shape, critic = _layers(tensors, "value", info.observation_size, 1)
        returns = (float(_tensor(moment)) for moment in _moments(tensors, "return_filter"))
        weights = {
            "observation.mean": _tensor(mean),
            "observation.std": _tensor(deviation),
            "log_std": torch.tensor(tensors["logstd"][0]),
            **layers,
        }
        stored = StoredCritic(critic_shape, critic, *returns)
        super().__init__(info, shape, weights, critic=stored, network=_ZooNetwork)
        self.standardize = _ZooStandardizer(
            weights["observation.mean"], weights["observation.std"], _tensor(1 / deviation)
        )

    def recurrent_state(self) -> State:
        """``actor.h`` and ``actor.c``, each (n, 128); empty without LSTM."""
        return {f"{_STATE}{name}": rows for name, rows in super().recurrent_state().items()}

    def load_recurrent_state(self, state: State) -> None:
        """Restore the result of :meth:`recurrent_state`; an empty one resets all games."""
        own = {name.removeprefix(_STATE): rows for name, rows in state.items() if name.startswith(_STATE)}
        super().load_recurrent_state(own)


class _ZooNetwork(PolicyNetwork):
    def cell(self, gates: Tensor, c: Tensor) -> LstmState:
        i, f, g, o = gates.chunk(4, dim=1)
        c = torch.addcmul(torch.sigmoid(f) * c, torch.sigmoid(i), torch.tanh(g))
        return torch.sigmoid(o) * torch.tanh(c), c


class _ZooStandardizer(Standardizer):
    scale: Tensor

    def __init__(self, mean: Tensor, std: Tensor, scale: Tensor):
        super().__init__(mean, std, CLIP)
        self.register_buffer("scale", scale)

    def forward(self, observation: Tensor) -> Tensor:
        return (observation - self.mean).mul_(self.scale).clamp_(-self.clip, self.clip)


def _moments(tensors: Tensors, name: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean and ``√max(variance, 0.01)`` of the agent's observations in training.

    In double precision: the variance is a small difference of large numbers.
    """
    total, squares, count = (
        tensors[f"{name}.{part}"].astype(np.float64) for part in ("sum", "sumsq", "count")
    )
    mean = total / count
    return mean, np.sqrt(np.maximum(squares / count - mean**2, _LEAST_VARIANCE))


def _layers(
    tensors: Tensors, net: str, observation_size: int, outputs: int
) -> tuple[NetworkShape, dict[str, Tensor]]:
    """Shape and weights of the body named ``net``; kernels are stored (inputs, outputs)."""
    if f"{net}.lstm.kernel" not in tensors:
        names = {"hidden_0": "mlp.0", "hidden_1": "mlp.1", "out": "mlp.2"}
        hidden = tuple(len(tensors[f"{net}.{name}.bias"]) for name in ("hidden_0", "hidden_1"))
        shape = NetworkShape("mlp", observation_size, outputs, 0, hidden, CLIP)
        return shape, _linears(tensors, net, names)
    embed, width = (len(tensors[f"{net}.{name}"]) for name in ("embed.bias", "out.kernel"))
    shape = NetworkShape("lstm", observation_size, outputs, width, (), CLIP, embed)
    # the file's order is i, j, f, o (j is torch's g), and it leaves out the +1 that its cell adds to f
    i, g, f, o = np.split(tensors[f"{net}.lstm.kernel"], 4, axis=1)
    kernel = np.concatenate((i, f, g, o), axis=1).T
    i, g, f, o = np.split(tensors[f"{net}.lstm.bias"], 4)
    bias = torch.tensor(np.concatenate((i, f + np.float32(1), g, o)))
    weights = {
        "rnn.weight_ih": torch.tensor(kernel[:, :embed]),
        "rnn.weight_hh": torch.tensor(kernel[:, embed:]),
        "rnn.bias_ih": bias,
        "rnn.bias_hh": torch.zeros_like(bias),
    }
    return shape, weights | _linears(tensors, net, {"embed": "embed", "out": "mlp.0"})


def _linears(tensors: Tensors, net: str, names: Mapping[str, str]) -> dict[str, Tensor]:
    found = {}
    for name, ours in names.items():
        found[f"{ours}.weight"] = torch.tensor(tensors[f"{net}.{name}.kernel"].T)
        found[f"{ours}.bias"] = torch.tensor(tensors[f"{net}.{name}.bias"])
    return found


def _tensor(value: NDArray[np.float64]) -> Tensor:
    return torch.tensor(value, dtype=torch.float32)
