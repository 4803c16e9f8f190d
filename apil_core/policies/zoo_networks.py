"""The zoo's two network bodies in torch: a tanh MLP and a one-layer LSTM.

Both take filtered observations and serve as policy and as value net. Everything is functional in the
recurrent state, so the same modules can be trained through time once ``requires_grad_`` is set.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from torch import Tensor, nn

from apil_core.policies.recurrent_state import State

Weights = Mapping[str, NDArray[np.float32]]

_MOMENTS = ("sum", "sumsq", "count")


class Output(NamedTuple):
    """What a network gives for one step of ``n`` games.

    Attributes:
        value: the linear output, shape (n, outputs).
        hidden: the last hidden layer, shape (n, width).
        state: recurrent state after the step, each (n, width); empty for the MLP.
    """

    value: Tensor
    hidden: Tensor
    state: State


class Network(nn.Module):
    """Shared interface of the two bodies; parameters come frozen."""

    recurrent = False

    def initial_state(self, games: int) -> State:
        """State at the start of a game, one row per game."""
        return {}

    def forward(self, z: Tensor, state: State) -> Output:
        """One step. ``z`` has shape (n, observation_size); ``state`` is not modified."""
        raise NotImplementedError


class Filter(nn.Module):
    """Standardises by the moments the agent saw in training: ``(x − mean) / √max(var, 0.01)``.

    Attributes:
        mean, deviation: of shape (size,), or () for the return filter.
    """

    mean: Tensor
    deviation: Tensor
    scale: Tensor

    def __init__(self, weights: Weights, name: str):
        super().__init__()
        # in double precision: the variance is a small difference of large numbers
        total, squares, count = (weights[f"{name}.{part}"].astype(np.float64) for part in _MOMENTS)
        mean = total / count
        deviation = np.sqrt(np.maximum(squares / count - mean**2, 0.01))
        for key, value in (("mean", mean), ("deviation", deviation), ("scale", 1 / deviation)):
            self.register_buffer(key, torch.tensor(value, dtype=torch.float32))

    def forward(self, x: Tensor) -> Tensor:
        """Standardised ``x``, same shape, not clipped."""
        return (x - self.mean).mul_(self.scale)


def make_network(weights: Weights, net: str) -> Network:
    """The body named ``net`` (``"policy"`` or ``"value"``) among an agent's tensors."""
    return LstmNetwork(weights, net) if f"{net}.lstm.kernel" in weights else MlpNetwork(weights, net)


class MlpNetwork(Network):
    """Two tanh layers and a linear one."""

    def __init__(self, weights: Weights, net: str):
        super().__init__()
        self.hidden_0 = _linear(weights, f"{net}.hidden_0")
        self.hidden_1 = _linear(weights, f"{net}.hidden_1")
        self.out = _linear(weights, f"{net}.out")

    def forward(self, z: Tensor, state: State) -> Output:
        """See :meth:`Network.forward`."""
        hidden = torch.tanh_(self.hidden_1(torch.tanh_(self.hidden_0(z))))
        return Output(self.out(hidden), hidden, state)


class LstmNetwork(Network):
    """A ReLU layer, an LSTM and a linear layer.

    With x the ReLU layer's output, all gates come from one product,
    ``[i f o j] = W [x; h] + b``; then ``c' = σ(f) c + σ(i) tanh(j)`` and ``h' = σ(o) tanh(c')``.
    The file keeps the gates in the order i, j, f, o and leaves out the +1 that its cell adds to f;
    here they are sorted so that one call squashes the three sigmoid gates, and b contains the +1.
    """

    recurrent = True

    def __init__(self, weights: Weights, net: str):
        super().__init__()
        self.embed = _linear(weights, f"{net}.embed")
        self.lstm = _gates(weights, f"{net}.lstm")
        self.out = _linear(weights, f"{net}.out")
        self.width = self.out.in_features

    def initial_state(self, games: int) -> State:
        """Zeros: ``h`` and ``c``, each (games, width)."""
        weight = self.out.weight
        return {key: weight.new_zeros(games, self.width) for key in ("h", "c")}

    def forward(self, z: Tensor, state: State) -> Output:
        """See :meth:`Network.forward`."""
        x = F.relu_(self.embed(z))
        gates = self.lstm(torch.cat((x, state["h"]), dim=1))
        squash, j = gates.split((3 * self.width, self.width), dim=1)
        i, f, o = torch.sigmoid(squash).chunk(3, dim=1)
        c = torch.addcmul(f * state["c"], i, torch.tanh(j))
        h = o * torch.tanh(c)
        return Output(self.out(h), h, {"h": h, "c": c})


def _linear(weights: Weights, name: str) -> nn.Linear:
    return _frozen(weights[f"{name}.kernel"].T, weights[f"{name}.bias"])


def _gates(weights: Weights, name: str) -> nn.Linear:
    order = ("i", "j", "f", "o")
    kernel = dict(zip(order, np.split(weights[f"{name}.kernel"], 4, axis=1), strict=True))
    bias = dict(zip(order, np.split(weights[f"{name}.bias"], 4), strict=True))
    bias["f"] = bias["f"] + np.float32(1)
    return _frozen(
        np.concatenate([kernel[gate].T for gate in "ifoj"]), np.concatenate([bias[gate] for gate in "ifoj"])
    )


def _frozen(weight: NDArray[np.float32], bias: NDArray[np.float32]) -> nn.Linear:
    outputs, inputs = weight.shape
    layer = nn.Linear(inputs, outputs, device="meta")  # no random initialisation: it would cost a draw
    layer.weight = nn.Parameter(torch.tensor(weight), requires_grad=False)
    layer.bias = nn.Parameter(torch.tensor(bias), requires_grad=False)
    return layer
