"""A compact policy distilled from another one: its shape and its networks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import torch
import torch.nn.functional as F
from torch import Tensor

from apil_core.api.policy import Policy, PolicyInfo
from apil_core.api.types import Decision, DiagonalGaussian, View
from apil_core.policies.recurrent_state import Memory, State

Kind = Literal["mlp", "lstm"]
Weights = Mapping[str, Tensor]

_RNN = ("weight_ih", "weight_hh", "bias_ih", "bias_hh")


@dataclass(frozen=True)
class StudentShape:
    """What a student's tensors mean.

    Attributes:
        kind: ``lstm`` below the MLP, or the MLP alone.
        observation_size, action_size: of the seat.
        width: of the LSTM; 0 for ``mlp``.
        hidden: tanh layers above it.
        clip: bound of the standardised observation.
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
        """Names and shapes of all tensors, weights as torch's own layers keep them."""
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


class StudentPolicy(Policy):
    """Standardised observation → optional ReLU layer → optional LSTM → tanh layers → mean action.

    Actions are drawn from a normal distribution whose standard deviation is its teacher's.

    Attributes:
        weights: the tensors, on the policy's device.

    Args:
        info: identity.
        shape: see :class:`StudentShape`.
        weights: tensors as :meth:`StudentShape.tensors` names them, float32.
    """

    def __init__(self, info: PolicyInfo, shape: StudentShape, weights: Weights):
        self.info = info
        self.shape = shape
        self.weights = dict(weights)
        self._std = self.weights["log_std"].exp()
        self._memory = Memory(info.name)

    @torch.no_grad()
    def act(
        self,
        view: View,
        *,
        sample: bool,
        generator: torch.Generator | None = None,
        activations: bool = False,
    ) -> Decision:
        """See :meth:`apil_core.Policy.act`; ``hidden`` is what the last linear layer reads."""
        w = self.weights
        z = (view.own.float() - w["observation.mean"]) / w["observation.std"]
        z = z.clamp_(-self.shape.clip, self.shape.clip)
        if self.shape.embed:
            z = F.relu_(F.linear(z, w["embed.weight"], w["embed.bias"]))
        x = self._remember(z, view.first)
        last = len(self.shape.hidden)
        for i in range(last):
            x = torch.tanh_(F.linear(x, w[f"mlp.{i}.weight"], w[f"mlp.{i}.bias"]))
        mean = F.linear(x, w[f"mlp.{last}.weight"], w[f"mlp.{last}.bias"])
        distribution = DiagonalGaussian(mean, self._std)
        action = distribution.sample(generator) if sample else mean
        return Decision(action, distribution, {"hidden": x} if activations else None)

    def _remember(self, z: Tensor, first: Tensor) -> Tensor:
        """Pass ``z`` through the LSTM, if there is one; (n, k) → (n, w)."""
        if self.shape.kind == "mlp":
            return z
        state = self._memory.begin(first, self._initial_state)
        weights = [self.weights[f"rnn.{name}"] for name in _RNN]
        h, c = torch.lstm_cell(z, (state["h"], state["c"]), *weights)
        self._memory.rows = {"h": h, "c": c}
        return h

    def _initial_state(self, games: int) -> State:
        return {key: self._std.new_zeros(games, self.shape.width) for key in ("h", "c")}

    def to(self, device: torch.device | str) -> StudentPolicy:
        """Move weights and state to ``device``; returns self."""
        self.weights = {name: tensor.to(device) for name, tensor in self.weights.items()}
        self._std = self._std.to(device)
        self.load_recurrent_state(self.recurrent_state())
        return self

    def recurrent_state(self) -> State:
        """``h`` and ``c``, each (n, width); empty without LSTM."""
        return dict(self._memory.rows)

    def load_recurrent_state(self, state: State) -> None:
        """Restore what :meth:`recurrent_state` gave; an empty one forgets all games."""
        self._memory.load(state, self._std.device)
