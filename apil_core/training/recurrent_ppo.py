"""PPO on given networks, recurrent or not: those of victims (zoo agents and students).

A recurrent network learns from sequences: each minibatch is some of the games over all T steps, starting
from the game's state at the start of the rollout (of the network before the update), cleared where games
end. Backpropagation through time is truncated at the start of the rollout.
"""

from __future__ import annotations

import math
from typing import Any, cast

import torch
from tensordict import TensorDict
from torch import Tensor, nn

from apil_core.api.config import PPOConfig
from apil_core.api.types import OWN_GROUP, DiagonalGaussian
from apil_core.policies.network import LstmState, PolicyNetwork
from apil_core.training.ppo import Actor, Learner
from apil_core.training.ppo_storage import LATENT
from apil_core.training.rollout_buffer import RolloutBuffer, trainable


class NetworkModel(nn.Module):
    """Adapter of a :class:`PolicyNetwork` to rsl_rl's models: an actor, or without ``log_std`` a critic.

    Args:
        network: reads standardised observations; a copy is trained.
        log_std: of the actions, (a,), trained like the weights.
    """

    def __init__(self, network: PolicyNetwork, log_std: Tensor | None = None):
        super().__init__()
        self.network = network
        self.log_std = None if log_std is None else nn.Parameter(log_std.clone())
        self._distribution: torch.distributions.Normal | None = None

    @property
    def model(self) -> NetworkModel:
        """The module that rsl_rl trains."""
        return self

    @property
    def is_recurrent(self) -> bool:
        """True if the network is recurrent."""
        return self.network.recurrent

    @property
    def std(self) -> Tensor:
        """Standard deviation of the action, the same for every observation, (a,)."""
        assert self.log_std is not None, "a critic has none"
        return self.log_std.exp()

    def forward(
        self,
        observations: TensorDict,
        masks: Tensor | None = None,
        hidden_state: LstmState | None = None,
        stochastic_output: bool = False,
    ) -> Tensor:
        """Mean actions or values, (m, a).

        Args:
            observations: standardised, batch (m,); of a recurrent network T·m, sequences of T steps.
            masks: ends of games, (T, m) bool.
            hidden_state: before the first step.
            stochastic_output: store the distribution for the properties below.
        """
        z = latent(observations)
        if self.is_recurrent:
            assert masks is not None
            assert hidden_state is not None
            output = self.network(z.view(*masks.shape, -1), masks, hidden_state)[0].flatten(0, 1)
        else:
            output = self.network(z, z, (z, z))[0]
        if stochastic_output:
            self._distribution = torch.distributions.Normal(
                output, self.std.expand_as(output), validate_args=False
            )
        return output

    def get_output_log_prob(self, actions: Tensor) -> Tensor:
        """Log density of actions (m, a) in the distribution stored last, (m,)."""
        assert self._distribution is not None
        return self._distribution.log_prob(actions).sum(-1)

    @property
    def output_distribution_params(self) -> tuple[Tensor, Tensor]:
        """Mean and standard deviation of the distribution stored last, (m, a) each."""
        assert self._distribution is not None
        return self._distribution.mean, self._distribution.stddev

    @property
    def output_entropy(self) -> Tensor:
        """Entropy of the distribution stored last, (m,)."""
        assert self._distribution is not None
        return self._distribution.entropy().sum(-1)

    def update_normalization(self, observations: TensorDict) -> None:
        """Keep the statistics: updating them would change the network's outputs."""

    @torch.no_grad()
    def rescale(self, factor: float, shift: float) -> None:
        """Rescale outputs to ``factor · output + shift``: a change of units, folded into the last layer."""
        last = self.network.mlp[-1]
        assert isinstance(last, nn.Linear)
        last.weight.mul_(factor)
        last.bias.mul_(factor).add_(shift)


class NetworkLearner(Learner):
    """:class:`Learner` on given networks; tracks the states of recurrent ones.

    Args:
        actor, critic: to train; a critic whose parameters require no gradient is not trained.
        example: standardised observations of all games, for shapes, batch (num_envs,).
        rollout: written by the environment.
        config: PPO's settings; ``hidden``, ``init_std`` and ``observation_clip`` are the networks' own.
        device: of the networks.
        horizon: longest game, in steps.
    """

    def __init__(
        self,
        actor: NetworkModel,
        critic: NetworkModel,
        example: TensorDict,
        rollout: RolloutBuffer,
        config: PPOConfig,
        device: torch.device,
        horizon: int,
    ):
        # it has the interface of an Actor that the learner uses
        super().__init__(cast(Actor, actor), example, rollout, config, device, horizon=horizon, critic=critic)
        self.policy = actor
        self.critic = critic
        games = len(example)
        self._states = [model.network.zero_state(games) for model in (actor, critic)]
        self._no_reset = torch.zeros(1, games, dtype=torch.bool, device=device)
        self._explained = math.nan

    def _mean(self, latent: Tensor) -> Tensor:
        if self.storage.step == 0:
            self.storage.states = tuple((trainable(h), trainable(c)) for h, c in self._states)
        mean, _, self._states[0] = self.policy.network.step(latent, self._states[0])
        return mean

    def ended(self, done: Tensor) -> None:
        """See :meth:`Learner.ended`; also resets the actor's state in those games."""
        super().ended(done)
        if self.policy.is_recurrent and bool(done.any()):
            h, c = (rows.masked_fill(done.unsqueeze(1), 0) for rows in self._states[0])
            self._states[0] = h, c

    @torch.no_grad()
    def forget(self) -> None:
        """Drop the rollout without an update; the networks' states are kept."""
        self._follow()
        self.storage.clear()

    def _follow(self) -> Tensor:
        """Values of the rollout, (T, n, 1); advances the critic's state to its end."""
        z, done = self.storage.observations[LATENT], self.storage.dones[..., 0].bool()
        values, self._states[1] = self.critic.network(z, done, self._states[1])
        return values

    def _values(self, last: TensorDict) -> tuple[Tensor, Tensor]:
        values = self._follow()
        following, _ = self.critic.network(latent(last).unsqueeze(0), self._no_reset, self._states[1])
        return values, following[0]

    def _present(self, observations: TensorDict) -> DiagonalGaussian:
        done = self.storage.dones[..., 0].bool()
        mean = self.policy(observations, done, self.storage.states[0])
        return DiagonalGaussian(mean, self.policy.std)

    def advantages(self, last: TensorDict, streams: Any) -> dict[str, Tensor]:
        """See :meth:`Learner.advantages`."""
        found = super().advantages(last, streams)
        spread, unforeseen = (float(values.var()) for values in (self.storage.returns, *found.values()))
        self._explained = 1 - unforeseen / spread if spread else math.nan
        return found

    def update(self, advantages: Tensor, **options: Any) -> dict[str, float]:
        """See :meth:`Learner.update`; also returns the explained variance of the critic."""
        return {**super().update(advantages, **options), "ppo/explained_variance": self._explained}

    def state_dict(self) -> dict[str, Any]:
        """Networks, optimiser, and the networks' states at an iteration boundary."""
        return {**super().state_dict(), "states": [list(state) for state in self._states]}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore the result of :meth:`state_dict`."""
        super().load_state_dict(state)
        for i, (h, c) in enumerate(state["states"]):
            self._states[i] = h.to(self.device), c.to(self.device)


def latent(observations: TensorDict) -> Tensor:
    """The only observation group, from the environment or the storage."""
    keys = observations.keys()
    group: Tensor = observations[LATENT if LATENT in keys else OWN_GROUP]
    return group
