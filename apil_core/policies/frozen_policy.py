"""A :class:`PolicyNetwork` with fixed weights as a policy."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from apil_core.api.policy import Policy, PolicyInfo
from apil_core.api.types import Decision, DiagonalGaussian, View
from apil_core.policies.network import NetworkShape, PolicyNetwork, Standardizer, Weights
from apil_core.policies.recurrent_state import Memory, State


@dataclass(frozen=True)
class StoredCritic:
    """A value network that came with a policy.

    Attributes:
        shape, weights: of the network; it gives normalised returns.
        mean, deviation: of the returns it was trained on: ``return = deviation · value + mean``.
    """

    shape: NetworkShape
    weights: Weights
    mean: float
    deviation: float


class FrozenPolicy(Policy):
    """Standardised observation → network → mean action; the spread is the same for every observation.

    Attributes:
        shape: of the network.
        critic: the value network it was trained with, if it has one.

    Args:
        info: identity.
        shape: see :class:`NetworkShape`.
        weights: tensors as :meth:`NetworkShape.tensors` names them, float32.
        critic: its value network.
        network: class of the network.
    """

    def __init__(
        self,
        info: PolicyInfo,
        shape: NetworkShape,
        weights: Weights,
        *,
        critic: StoredCritic | None = None,
        network: type[PolicyNetwork] = PolicyNetwork,
    ):
        self.info = info
        self.shape = shape
        self.critic = critic
        self.network = network.of(shape, weights).requires_grad_(False)
        self.standardize = Standardizer(weights["observation.mean"], weights["observation.std"], shape.clip)
        self._log_std = weights["log_std"]
        self._std = self._log_std.exp()
        self._memory = Memory(info.name)

    @property
    def weights(self) -> dict[str, Tensor]:
        """All tensors as a file has them, on the policy's device."""
        statistics = {"observation.mean": self.standardize.mean, "observation.std": self.standardize.std}
        return {**statistics, "log_std": self._log_std, **self.network.state_dict()}

    # the weights need no gradients, so there is a graph only where the observation does (white-box methods)
    def act(
        self,
        view: View,
        *,
        sample: bool,
        generator: torch.Generator | None = None,
        activations: bool = False,
    ) -> Decision:
        """See :meth:`apil_core.Policy.act`; ``hidden`` is what the last linear layer reads."""
        seen = view.own.shape[-1]
        if seen != self.shape.observation_size:
            raise ValueError(f"{self.info.name} reads {self.shape.observation_size} observations, got {seen}")
        rows = self._memory.begin(view.first, self._initial_state) if self.network.recurrent else {}
        z = self.standardize(view.own.float())
        mean, hidden, (h, c) = self.network.step(z, (rows.get("h", z), rows.get("c", z)))
        if rows:
            self._memory.rows = {"h": h, "c": c}
        distribution = DiagonalGaussian(mean, self._std)
        action = distribution.sample(generator) if sample else mean
        return Decision(action, distribution, {"hidden": hidden} if activations else None)

    def _initial_state(self, games: int) -> State:
        return dict(zip(("h", "c"), self.network.zero_state(games), strict=True))

    def to(self, device: torch.device | str) -> FrozenPolicy:
        """Move weights and state to ``device``; returns self."""
        self.network.to(device)
        self.standardize.to(device)
        self._log_std, self._std = self._log_std.to(device), self._std.to(device)
        self.load_recurrent_state(self.recurrent_state())
        return self

    def recurrent_state(self) -> State:
        """``h`` and ``c``, each (n, width); empty without LSTM."""
        return dict(self._memory.rows)

    def load_recurrent_state(self, state: State) -> None:
        """Restore the result of :meth:`recurrent_state`; an empty one resets all games."""
        self._memory.load(state, self._std.device)
