"""Rollout storage of PPO's update: rsl_rl's storage and model, without their copies."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import torch
from rsl_rl.models import MLPModel
from rsl_rl.modules.distribution import GaussianDistribution
from rsl_rl.storage import RolloutStorage
from tensordict import TensorDict
from torch import Tensor

from apil_core.api.types import PRIVILEGED_GROUP
from apil_core.training.rollout_buffer import RolloutBuffer

LATENT = "latent"
"""Name of the concatenation of the actor's observation groups in the storage."""
_ALL = "latent and privileged"
"""Name of what critics read in the storage: :data:`LATENT` is the view of its first columns."""


class LatentModel(MLPModel):
    """rsl_rl's MLP, which also accepts concatenated groups.

    rsl_rl joins the groups in every forward pass; a rollout is joined once, when it is stored.
    """

    def get_latent(self, obs: TensorDict, masks: None = None, hidden_state: None = None) -> Tensor:
        """The network's input, (..., k)."""
        # a method may name a group "latent": the joined tensor has no first group
        if self.obs_groups[0] not in obs.keys():  # noqa: SIM118  (a TensorDict refuses `in`)
            return obs[_ALL if PRIVILEGED_GROUP in self.obs_groups else LATENT]
        groups = [obs[name] for name in self.obs_groups]
        return torch.cat(groups, dim=-1) if len(groups) > 1 else groups[0]

    def forward(
        self,
        obs: TensorDict,
        masks: None = None,
        hidden_state: None = None,
        stochastic_output: bool = False,
    ) -> Tensor:
        """Mean actions or values, (m, a); draws no sample, which PPO's update would not read."""
        output: Tensor = self.mlp(self.get_latent(obs))
        if stochastic_output:
            self.distribution.update(output)
        return output


class Gaussian(GaussianDistribution):
    """rsl_rl's, for one standard deviation of all rows: its logarithm is not computed for each row."""

    def update(self, mlp_output: Tensor) -> None:
        """Set the means, (m, a)."""
        self._mean = mlp_output
        self._log_std = self.log_std_param.clamp(*self.log_std_range)

    @property
    def mean(self) -> Tensor:
        """(m, a)."""
        return self._mean

    @property
    def std(self) -> Tensor:
        """(m, a)."""
        return self._log_std.exp().expand_as(self._mean)

    @property
    def entropy(self) -> Tensor:
        """(m,), in nats."""
        each = self._log_std + 0.5 * (1 + math.log(2 * math.pi))
        return each.sum().expand(len(self._mean))

    def log_prob(self, outputs: Tensor) -> Tensor:
        """Log density of ``outputs`` (m, a), (m,)."""
        z = (outputs - self._mean) * (-self._log_std).exp()
        constant = self._log_std.sum() + 0.5 * math.log(2 * math.pi) * self.output_dim
        return -0.5 * z.square().sum(-1) - constant


class PPOStorage(RolloutStorage):
    """One rollout, T steps of n games, with PPO's own data: joined observations, means, values.

    Actions, rewards and ends share the memory of the rollout that hooks read.

    Attributes:
        means: of the distributions the actions were drawn from, (T, n, a).
        states: of recurrent actor and critic before the first step, each h and c, (n, w).
        goes_on: called before each pass but the first; False ends the update.
        passes: of the last update.

    Args:
        example: normalised observation groups of all games, batch (n,); the critics' own may be among them.
        rollout: written by the environment, one step after each :meth:`next_latent`.
        action_size: a.
        device: of the tensors.
    """

    def __init__(self, example: TensorDict, rollout: RolloutBuffer, action_size: int, device: torch.device):
        self._width = sum(example[name].shape[-1] for name in example.keys() if name != PRIVILEGED_GROUP)  # noqa: SIM118
        games, steps = len(example), rollout.num_steps
        none = TensorDict(
            {}, batch_size=[games]
        )  # the joined ones, of which rsl_rl knows nothing, replace them
        super().__init__("rl", games, steps, none, [action_size], device=str(device))
        self._latents = torch.zeros(steps, *_joined(example).shape, device=device)
        self.observations: TensorDict = self._views(self._latents)
        row = torch.zeros(games, device=device)
        self.actions: Tensor = rollout.column("action", row.unsqueeze(-1).repeat(1, action_size))
        self.rewards: Tensor = rollout.column("shaped_reward", row).unsqueeze(-1)
        self.dones: Tensor = rollout.column("done", row.bool()).unsqueeze(-1)
        self.means = torch.zeros_like(self.actions)
        self.goes_on: Callable[[], bool] = lambda: True
        self.passes = 0
        self.states: tuple[tuple[Tensor, Tensor], ...] = ()

    def next_latent(self, observations: TensorDict) -> Tensor:
        """Store the observation groups of a step; returns the actor's concatenated, (n, k)."""
        return _joined(observations, out=self._latents[self.step])[..., : self._width]

    def keep_mean(self, mean: Tensor) -> None:
        """Store the mean of the action's distribution, (n, a), and advance to the next step."""
        self.means[self.step].copy_(mean)
        self.step += 1

    def keep_log_prob(self, std: Tensor) -> None:
        """Store the log density of all stored actions under standard deviation ``std`` (a,)."""
        log_prob = torch.distributions.Normal(self.means, std).log_prob(self.actions)
        self.actions_log_prob.copy_(log_prob.sum(-1, keepdim=True))

    def mini_batch_generator(
        self, num_mini_batches: int, num_epochs: int = 8
    ) -> Iterator[RolloutStorage.Batch]:
        """The batches of rsl_rl's generator, which shuffles once for all epochs; gathered once.

        Ends early if :attr:`goes_on` returns False.
        """
        rows = self.num_envs * self.num_transitions_per_env
        size = rows // num_mini_batches
        order = torch.randperm(rows, device=self.device)[: num_mini_batches * size]
        shuffled = {name: column.flatten(0, 1)[order] for name, column in self._columns().items()}
        for _ in self._passes(num_epochs):
            for start in range(0, len(order), size):
                part = slice(start, start + size)
                yield self._batch({name: column[part] for name, column in shuffled.items()})

    def recurrent_mini_batch_generator(
        self, num_mini_batches: int, num_epochs: int = 8
    ) -> Iterator[RolloutStorage.Batch]:
        """Batches of some of the games over all T steps, for recurrent networks; shuffled once, too.

        Their columns are flat, (T·m, …), as for feed-forward ones; ``masks`` are the ends of games, (T, m)
        bool, and ``hidden_states`` those before the first step.
        """
        batches = []
        order = torch.randperm(self.num_envs, device=self.device)
        for games in order.tensor_split(num_mini_batches):
            columns = {name: column[:, games].flatten(0, 1) for name, column in self._columns().items()}
            states = tuple((h[games], c[games]) for h, c in self.states)
            batches.append((columns, self.dones[:, games, 0].bool(), states))
        for _ in self._passes(num_epochs):
            for columns, ends, states in batches:
                yield self._batch(columns, masks=ends, hidden_states=states)

    def _batch(self, columns: dict[str, Tensor], **others: Any) -> RolloutStorage.Batch:
        observations = self._views(columns["observations"])
        return RolloutStorage.Batch(**{**columns, "observations": observations}, **others)

    def _views(self, joined: Tensor) -> TensorDict:
        """What actor and critics read of all columns, (..., k)."""
        views = {_ALL: joined, LATENT: joined[..., : self._width]}
        return TensorDict(views, batch_size=joined.shape[:-1])

    def _columns(self) -> dict[str, Tensor]:
        return {
            "observations": self._latents,
            "actions": self.actions,
            "values": self.values,
            "advantages": self.advantages,
            "returns": self.returns,
            "old_actions_log_prob": self.actions_log_prob,
        }

    def _passes(self, epochs: int) -> Iterator[int]:
        for number in range(1, epochs + 1):
            if number > 1 and not self.goes_on():
                return
            self.passes = number
            yield number


def _joined(observations: TensorDict, out: Tensor | None = None) -> Tensor:
    """All groups side by side, (n, k), the critics' own last; iterating over a TensorDict goes over games."""
    names = sorted(observations.keys(), key=lambda name: name == PRIVILEGED_GROUP)
    return torch.cat([observations[name] for name in names], dim=-1, out=out)
