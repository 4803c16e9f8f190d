"""A zoo agent as a :class:`apil_core.Policy`."""

from __future__ import annotations

from typing import Literal

import torch
from torch import Tensor

from apil_core.api.policy import Policy, PolicyInfo
from apil_core.api.types import Decision, DiagonalGaussian, View
from apil_core.policies.recurrent_state import Memory
from apil_core.policies.zoo_networks import Filter, Output, Weights, make_network

_Net = Literal["actor", "critic"]


class ZooPolicy(Policy):
    """A frozen agent of Bansal et al. 2018.

    Sees its observation filtered by the mean and variance of its own training, clipped to ±5, and
    draws from a normal distribution whose standard deviation does not depend on the observation.

    Attributes:
        actor: torch module from filtered observation to mean action.
        critic: torch module from filtered observation to normalised return.
        logstd: of the action, shape (a,).
        observation_filter, return_filter: statistics of its own training.
    """

    CLIP = 5.0
    """Bound of the filtered observation."""

    def __init__(self, info: PolicyInfo, weights: Weights):
        self.info = info
        self.actor = make_network(weights, "policy")
        self.critic = make_network(weights, "value")
        self.logstd = torch.tensor(weights["logstd"][0])
        self.observation_filter = Filter(weights, "observation_filter")
        self.return_filter = Filter(weights, "return_filter")
        self._std = self.logstd.exp()
        self._memories: dict[_Net, Memory] = {"actor": Memory(info.name), "critic": Memory(info.name)}

    # no_grad rather than inference_mode, whose tensors could not enter a loss (measured: no slower)
    @torch.no_grad()
    def act(
        self,
        view: View,
        *,
        sample: bool,
        generator: torch.Generator | None = None,
        activations: bool = False,
    ) -> Decision:
        """See :meth:`apil_core.Policy.act`; ``hidden`` is the last tanh layer, or the LSTM's h."""
        output = self._advance("actor", view)
        distribution = DiagonalGaussian(output.value, self._std)
        action = distribution.sample(generator) if sample else output.value
        return Decision(action, distribution, {"hidden": output.hidden} if activations else None)

    @torch.no_grad()
    def value(self, view: View) -> Tensor:
        """The agent's estimate of its return in its own training's units, shape (n,).

        The critic has a recurrent state of its own: call this once per step, as :meth:`act`.
        """
        output = self._advance("critic", view)
        return output.value[:, 0] * self.return_filter.deviation + self.return_filter.mean

    def filter(self, observation: Tensor) -> Tensor:
        """What the networks see of ``observation``; both (n, observation_size)."""
        size = self.info.observation_size
        if observation.shape[-1] != size:
            raise ValueError(f"{self.info.name} reads {size} observations, got {observation.shape[-1]}")
        return self.observation_filter(observation.float()).clamp_(-self.CLIP, self.CLIP)

    def _advance(self, net: _Net, view: View) -> Output:
        network = self.actor if net == "actor" else self.critic
        memory = self._memories[net]
        state = memory.begin(view.first, network.initial_state) if network.recurrent else {}
        output = network(self.filter(view.own), state)
        memory.rows = output.state
        return output

    def to(self, device: torch.device | str) -> ZooPolicy:
        """Move weights and state to ``device``; returns self."""
        for module in (self.actor, self.critic, self.observation_filter, self.return_filter):
            module.to(device)
        self.logstd, self._std = self.logstd.to(device), self._std.to(device)
        self.load_recurrent_state(self.recurrent_state())
        return self

    def recurrent_state(self) -> dict[str, Tensor]:
        """``actor.h`` and ``actor.c``, each (n, 128), and the critic's if it was asked; else nothing."""
        return {
            f"{net}.{key}": rows
            for net, memory in self._memories.items()
            for key, rows in memory.rows.items()
        }

    def load_recurrent_state(self, state: dict[str, Tensor]) -> None:
        """Restore what :meth:`recurrent_state` gave; an empty one forgets all games."""
        for memory in self._memories.values():
            memory.rows = {}
        for name, rows in state.items():
            net, _, key = name.partition(".")
            self._memories[net].rows[key] = rows.to(self._std.device, copy=True)  # type: ignore[index]
