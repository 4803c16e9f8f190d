"""The network of zoo agents, students and hardened victims, with its weights named as in files."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, Self

import torch
import torch.nn.functional as F
from torch import Tensor, nn

Kind = Literal["mlp", "lstm"]
Weights = Mapping[str, Tensor]
LstmState = tuple[Tensor, Tensor]
"""h and c of an LSTM, each (n, w)."""

_RNN = ("weight_ih", "weight_hh", "bias_ih", "bias_hh")


@dataclass(frozen=True)
class NetworkShape:
    """Architecture of a network, which determines its tensors.

    Agents of Bansal et al. 2018: ``mlp`` with hidden (64, 64), or ``lstm`` with embed 128, width 128 and no
    hidden layers; clip 5. ``MlpPolicy`` of Stable-Baselines with ``VecNormalize``: (64, 64), clip 10.

    Attributes:
        kind: ``lstm`` below the MLP, or the MLP alone.
        observation_size, action_size: of the seat; a critic's only action is the value.
        width: of the LSTM; 0 for ``mlp``.
        hidden: widths of the tanh layers above it.
        clip: bound of the standardised observation, in standard deviations.
        embed: ReLU units between observation and LSTM; 0: none.
    """

    kind: Kind
    observation_size: int
    action_size: int
    width: int
    hidden: tuple[int, ...]
    clip: float
    embed: int = 0

    def tensors(self) -> dict[str, tuple[int, ...]]:
        """Names and shapes of a file's tensors, in the layout of torch's layers.

        ``observation.mean`` and ``observation.std`` (o,); ``log_std`` (a,); ``embed.*``; ``rnn.*`` of an LSTM
        cell, gates in the order i, f, g, o; ``mlp.0.weight`` (outputs, inputs), ``mlp.0.bias``, ….
        """
        o, a, w = self.observation_size, self.action_size, self.width
        shapes: dict[str, tuple[int, ...]] = {
            "observation.mean": (o,),
            "observation.std": (o,),
            "log_std": (a,),
        }
        recurrent = self.kind == "lstm"
        if self.embed:
            shapes |= {"embed.weight": (self.embed, o), "embed.bias": (self.embed,)}
        if recurrent:
            sizes = ((4 * w, self.embed or o), (4 * w, w), (4 * w,), (4 * w,))
            shapes |= {f"rnn.{name}": size for name, size in zip(_RNN, sizes, strict=True)}
        inputs = (w if recurrent else self.embed or o, *self.hidden)
        for i, (size, outputs) in enumerate(zip(inputs, (*self.hidden, a), strict=True)):
            shapes |= {f"mlp.{i}.weight": (outputs, size), f"mlp.{i}.bias": (outputs,)}
        return shapes


class Standardizer(nn.Module):
    """``clip((x − mean) / std, ±clip)`` by fixed statistics, (o,) each."""

    mean: Tensor
    std: Tensor

    def __init__(self, mean: Tensor, std: Tensor, clip: float):
        super().__init__()
        self.clip = clip
        self.register_buffer("mean", mean.clone())
        self.register_buffer("std", std.clone())

    def forward(self, observation: Tensor) -> Tensor:
        """(..., o) → (..., o)."""
        return ((observation - self.mean) / self.std).clamp_(-self.clip, self.clip)


class PolicyNetwork(nn.Module):
    """Standardised observation → ReLU layer and LSTM (or neither) → tanh layers → linear output.

    Weights are initialised randomly, or given to :meth:`of`. With gates ``[i f g o] = W_x x + W_h h + b``
    the LSTM's state becomes ``c' = σ(f) c + σ(i) tanh(g)``, ``h' = σ(o) tanh(c')``.
    """

    def __init__(self, shape: NetworkShape):
        super().__init__()
        self.shape = shape
        inputs = shape.observation_size
        if shape.embed:
            self.embed = nn.Linear(inputs, shape.embed)
            inputs = shape.embed
        if shape.kind == "lstm":
            self.rnn = nn.LSTMCell(inputs, shape.width)
            inputs = shape.width
        sizes = (inputs, *shape.hidden, shape.action_size)
        self.mlp = nn.ModuleList(nn.Linear(a, b) for a, b in itertools.pairwise(sizes))

    @classmethod
    def of(cls, shape: NetworkShape, weights: Weights) -> Self:
        """A network on those of ``weights`` that are layers' (no copies); draws no random numbers."""
        with torch.device("meta"):
            network = cls(shape)
        network.load_state_dict({name: weights[name] for name in network.state_dict()}, assign=True)
        return network

    @property
    def recurrent(self) -> bool:
        """True if it has an LSTM."""
        return self.shape.kind == "lstm"

    def step(self, z: Tensor, state: LstmState) -> tuple[Tensor, Tensor, LstmState]:
        """One step of n games.

        Args:
            z: standardised observations, (n, o).
            state: before the step, not modified; unused without LSTM.

        Returns:
            output (n, a), what the last linear layer reads (n, k), and the state after the step.
        """
        x = F.relu(self.embed(z)) if self.shape.embed else z
        if self.recurrent:
            cell, (h, c) = self.rnn, state
            gates = F.linear(h, cell.weight_hh, cell.bias_hh) + F.linear(x, cell.weight_ih, cell.bias_ih)
            x, c = self.cell(gates, c)
            state = x, c
        output, x = self._output(x)
        return output, x, state

    def forward(self, z: Tensor, done: Tensor, state: LstmState) -> tuple[Tensor, LstmState]:
        """A sequence of T steps of n games, with gradients through time.

        Args:
            z: standardised observations, (T, n, o).
            done: (T, n) bool, a game ended with this step: the next one starts from zeros.
            state: before the first step; unused without LSTM.

        Returns:
            (T, n, a), and the state after the last step.
        """
        x = F.relu(self.embed(z)) if self.shape.embed else z
        if self.recurrent:
            x, state = self._remember(x, done, state)
        return self._output(x)[0], state

    def _remember(self, x: Tensor, done: Tensor, state: LstmState) -> tuple[Tensor, LstmState]:
        cell, (h, c) = self.rnn, state
        # of all steps in one product; unbound, as the gradient of one indexed step is as large as all steps
        own = F.linear(x, cell.weight_ih, cell.bias_ih + cell.bias_hh).unbind()
        keep = (~done).to(x.dtype).unsqueeze(-1)
        ends = done.any(1).tolist()
        states = []
        for t, own_t in enumerate(own):
            h, c = self.cell(torch.addmm(own_t, h, cell.weight_hh.t()), c)
            states.append(h)
            if ends[t]:
                h, c = h * keep[t], c * keep[t]
        return torch.stack(states), (h, c)

    def cell(self, gates: Tensor, c: Tensor) -> LstmState:
        """The LSTM's new state from its gates, (n, 4w), and its old c, (n, w)."""
        i, f, g, o = gates.chunk(4, dim=1)
        c = torch.sigmoid(f) * c + torch.sigmoid(i) * torch.tanh(g)
        return torch.sigmoid(o) * torch.tanh(c), c

    def _output(self, x: Tensor) -> tuple[Tensor, Tensor]:
        *hidden, last = self.mlp
        for layer in hidden:
            x = torch.tanh(layer(x))
        return last(x), x

    def zero_state(self, games: int) -> LstmState:
        """LSTM state at the start of games, h and c, (games, width) each."""
        zeros = torch.zeros(games, self.shape.width, device=next(self.parameters()).device)
        return zeros, zeros
