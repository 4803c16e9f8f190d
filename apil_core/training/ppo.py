"""PPO for every method, on rsl_rl's algorithm, models and storage. Together with
``ppo_storage`` the only place that imports rsl_rl.

Differences of rsl_rl from the published PPO are configured here (docs/methods.md §3, PPO):
fixed schedule with the learning rate annealed from outside, value loss clipped by default,
advantages normalised per minibatch, ½ in the value loss, Adam's epsilon 1e-5, orthogonal initial weights.
Accepted departures: actor and critic are clipped separately; one permutation serves all epochs.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping
from typing import Any

import torch
from rsl_rl.algorithms import PPO
from rsl_rl.utils import reduce_gradients_in_buckets
from tensordict import TensorDict
from torch import Tensor, nn

from apil_core.api.config import PPOConfig
from apil_core.api.types import DiagonalGaussian
from apil_core.common.errors import ApilError
from apil_core.training.distributed.world import ALONE, World
from apil_core.training.exploration import make_noise
from apil_core.training.networks import mlp
from apil_core.training.ppo_storage import Gaussian, LatentModel, PPOStorage
from apil_core.training.returns import gae
from apil_core.training.rollout_buffer import RolloutBuffer

_ADAM_EPSILON = 1e-5
MAIN_STREAM = "reward"
_BUCKET_MB = 25.0
"""Largest message in which processes exchange gradients, as rsl_rl's PPO has it."""


class Actor(nn.Module):
    """The adversary's policy network on normalised observation groups; what is exported after training.

    Args:
        groups: sizes of its observation groups, in the order they are concatenated.
        action_size: of the adversary.
        config: hidden sizes, initial spread and unit of actions.
        limit: of the adversary's motors.
    """

    def __init__(self, groups: Mapping[str, int], action_size: int, config: PPOConfig, limit: float = 1.0):
        super().__init__()
        self.groups = dict(groups)
        example = TensorDict({name: torch.zeros(1, size) for name, size in groups.items()}, batch_size=[1])
        self.unit = limit if config.action_unit == "limit" else 1.0
        self.model = _model(example, action_size, config, self.unit)
        self._depth = len(config.hidden)
        if config.action_unit == "limit":
            self.model.mlp.append(_Times(self.unit))

    def forward(self, observations: TensorDict) -> DiagonalGaussian:
        """Distribution of the action, (n, a)."""
        model = self.model
        return DiagonalGaussian(model.mlp(model.get_latent(observations)), self.std)

    @property
    def std(self) -> Tensor:
        """Standard deviation of the action, the same for every observation, (a,)."""
        return self.model.distribution.log_std_param.exp()

    def hidden(self, observations: TensorDict) -> Tensor:
        """Last hidden layer, (n, h)."""
        latent = self.model.get_latent(observations)
        for layer in list(self.model.mlp)[: 2 * self._depth]:
            latent = layer(latent)
        return latent


class _Times(nn.Module):
    """Multiplies by a constant."""

    def __init__(self, factor: float):
        super().__init__()
        self.factor = factor

    def forward(self, value: Tensor) -> Tensor:
        return value * self.factor


def _model(
    example: TensorDict, output_size: int, config: PPOConfig, unit: float | None = None
) -> LatentModel:
    """An actor's network if ``unit``, the unit of its standard deviation, is given, else a critic's."""
    stochastic = unit is not None
    names = list(example.keys())
    distribution = {
        "class_name": Gaussian,
        "init_std": config.init_std * (unit or 1.0),
        "std_type": "log",
    }
    model = LatentModel(
        example,
        {"observations": names},
        "observations",
        output_size,
        hidden_dims=config.hidden,
        activation="tanh",
        distribution_cfg=distribution if stochastic else None,
    )
    sizes = (model.obs_dim, *config.hidden, output_size)
    published = mlp(sizes, output_gain=0.01 if stochastic else 1.0)
    model.mlp.load_state_dict(published.state_dict())
    return model


class Learner:
    """Actor, critics, storage and PPO's update.

    Args:
        actor: the policy to train.
        example: normalised observations of all games, for shapes, batch (num_envs,).
        rollout: which the environment writes.
        config: PPO's settings.
        device: of the networks.
        world: processes whose gradients are averaged.
        horizon: longest game, in steps (for exploration noise).
        critic: values' network; default: one of ``config.hidden``.
    """

    def __init__(
        self,
        actor: Actor,
        example: TensorDict,
        rollout: RolloutBuffer,
        config: PPOConfig,
        device: torch.device,
        world: World = ALONE,
        horizon: int = 1000,
        critic: nn.Module | None = None,
    ):
        self.config = config
        self.device = device
        self.world = world
        self.actor = actor.to(device)
        self._example = example[:1].clone()
        action_size = actor.std.numel()
        self.storage = PPOStorage(example, rollout, action_size, device)
        self.ppo = PPO(
            actor.model,
            critic or _model(example, 1, config),
            self.storage,
            num_learning_epochs=config.epochs,
            num_mini_batches=config.minibatches,
            clip_param=config.clip,
            gamma=config.gamma,
            lam=config.lam,
            value_loss_coef=0.5 * config.value_coefficient,
            entropy_coef=config.entropy_coefficient,
            learning_rate=config.learning_rate,
            max_grad_norm=config.max_grad_norm,
            optimizer=config.optimizer,
            use_clipped_value_loss=config.clip_value,
            schedule="fixed",
            normalize_advantage_per_mini_batch=True,
            device=str(device),
            multi_gpu_cfg=world.multi_gpu_cfg,
        )
        self._set_adam()
        self.critics: dict[str, StreamCritic] = {}
        self.noise = make_noise(config, len(example), action_size, horizon, device)

    def _set_adam(self) -> None:
        for group in self.ppo.optimizer.param_groups:
            # one kernel for all tensors: a dozen for each were a seventh of an update of networks this small
            group.update(eps=_ADAM_EPSILON, fused=True)

    def start_equal(self) -> None:
        """Give all processes the first one's networks."""
        if self.world.size == 1:
            return
        self.ppo.broadcast_parameters()
        for critic in self.critics.values():
            critic.start_equal()

    @torch.no_grad()
    def act(self, observations: TensorDict) -> Tensor:
        """Draw actions (n, a) from torch's global generator, and store the inputs of the update."""
        latent = self.storage.next_latent(observations)
        mean = self._mean(latent)
        if self.noise is None:
            action = torch.normal(mean, self.actor.std.expand_as(mean))
        else:  # densities assume white noise: a bias accepted in exchange for better exploration
            action = mean + self.actor.std * self.noise.draw()
        self.storage.keep_mean(mean)
        return action

    def _mean(self, latent: Tensor) -> Tensor:
        mean: Tensor = self.actor.model.mlp(latent)
        return mean

    def ended(self, done: Tensor) -> None:
        """Reset the exploration noise of the games that ended with the step, (n,) bool."""
        if self.noise is not None:
            self.noise.renew(done)

    def distribution(self) -> DiagonalGaussian:
        """Distribution of the stored actions, (T, n, a); views of the storage."""
        means = self.storage.means
        return DiagonalGaussian(means, self.actor.std.detach().expand_as(means))

    def advantages(self, last: TensorDict, streams: Mapping[str, Tensor]) -> dict[str, Tensor]:
        """GAE per reward stream, each (T, n); also sets every critic's targets.

        Args:
            last: observations after the last step.
            streams: reward streams beside the main one, each (T, n).
        """
        storage = self.storage
        with torch.no_grad():  # not inference mode: plugins may train on the result
            # one pass over the whole rollout: the critic is not needed while it is collected
            values, next_value = self._values(last)
            storage.values.copy_(values)
            storage.keep_log_prob(self.actor.std)
            main = self._gae(storage.rewards[..., 0], storage.values[..., 0], next_value[:, 0])
            storage.returns.copy_((main + storage.values[..., 0]).unsqueeze(-1))
        result = {MAIN_STREAM: main}
        for name, rewards in streams.items():
            if name not in self.critics:
                self._stream_critic(name).start_equal()
            result[name] = self.critics[name].advantages(self, rewards, last)
        return result

    def _values(self, last: TensorDict) -> tuple[Tensor, Tensor]:
        """Values of the rollout's observations, (T, n, 1), and of the last ones, (n, 1)."""
        return self.ppo.critic(self.storage.observations), self.ppo.critic(last)

    def _present(self, observations: TensorDict) -> DiagonalGaussian:
        """The current policy's action distribution at the rollout's observations, (T·n, a)."""
        present: DiagonalGaussian = self.actor(observations)
        return present

    def update(
        self, advantages: Tensor, *, as_given: bool, learning_rate: float, actor_fixed: bool = False
    ) -> dict[str, float]:
        """PPO's epochs over the stored rollout, and the streams' critics.

        Args:
            advantages: (T, n).
            as_given: true for mixed streams, which arrive normalised per rollout; false: normalise
                per minibatch.
            learning_rate: for this iteration.
            actor_fixed: update the critics alone.
        """
        ppo = self.ppo
        ppo.learning_rate = learning_rate
        for group in ppo.optimizer.param_groups:
            group["lr"] = learning_rate
        ppo.normalize_advantage_per_mini_batch = not as_given
        self.storage.advantages.copy_(advantages.unsqueeze(-1))
        observations = self.storage.observations.flatten(0, 1)
        before = DiagonalGaussian(self.storage.means.flatten(0, 1), self.actor.std.detach().clone())

        def kl() -> float:
            with torch.inference_mode():
                return float(before.kl(self._present(observations)).mean())

        limit = None if actor_fixed else self.config.max_kl
        if limit is not None:
            self.storage.goes_on = lambda: not self.world.any(kl() > limit)
        fixed = copy.deepcopy(self.actor.state_dict()) if actor_fixed else None
        losses, passes = ppo.update(), self.storage.passes
        if fixed is not None:  # rsl_rl has one optimiser for both
            self.actor.load_state_dict(fixed)
            for parameter in self.actor.parameters():
                ppo.optimizer.state.pop(parameter, None)
        # rsl_rl divides by the planned passes
        metrics = {
            f"ppo/{name}": float(value) * self.config.epochs / passes for name, value in losses.items()
        }
        metrics |= {"ppo/kl": kl(), "ppo/std": float(self.actor.std.detach().mean()), "ppo/passes": passes}
        if not math.isfinite(metrics["ppo/kl"] + metrics["ppo/value"]):
            raise ApilError(
                f"the policy became NaN or infinite in this update (ppo.learning_rate {learning_rate:g}); "
                "lower the learning rate and resume from the last checkpoint"
            )
        metrics["ppo/learning_rate"] = learning_rate
        for name, critic in self.critics.items():
            metrics[f"ppo/value_{name}"] = critic.update(observations, learning_rate)
        return metrics

    def state_dict(self) -> dict[str, Any]:
        """Networks and optimisers; the storage is empty at iteration boundaries."""
        return {
            "ppo": self.ppo.save(),
            "critics": {name: critic.state_dict() for name, critic in self.critics.items()},
            "noise": None if self.noise is None else self.noise.state_dict(),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore the result of :meth:`state_dict`."""
        self.ppo.load(state["ppo"], None, strict=True)
        self._set_adam()  # older checkpoints bring the slower one along
        for moments in self.ppo.optimizer.state.values():
            moments["step"] = moments["step"].to(self.device)
        for name, critic in state["critics"].items():
            self._stream_critic(name).load_state_dict(critic)
        if self.noise is not None:
            self.noise.load_state_dict(state["noise"])

    def load_networks(self, state: dict[str, Any]) -> None:
        """Load actor and critics of another run's :meth:`state_dict`, with fresh optimisers."""
        self.ppo.load(state["ppo"], {"actor": True, "critic": True}, strict=True)
        for name, critic in state["critics"].items():
            self._stream_critic(name).model.load_state_dict(critic["model"])

    def _gae(self, rewards: Tensor, values: Tensor, next_value: Tensor) -> Tensor:
        done = self.storage.dones[..., 0]
        return gae(rewards, values, next_value, done, gamma=self.config.gamma, lam=self.config.lam)

    def _stream_critic(self, name: str) -> StreamCritic:
        if name not in self.critics:
            model = _model(self._example, 1, self.config).to(self.device)
            self.critics[name] = StreamCritic(model, self.config, self.world)
        return self.critics[name]


class StreamCritic:
    """The critic of one further reward stream, with its own optimiser."""

    def __init__(self, model: LatentModel, config: PPOConfig, world: World):
        self.model = model
        self.config = config
        self.world = world
        kind = torch.optim.AdamW if config.optimizer == "adamw" else torch.optim.Adam
        self.optimizer = kind(model.parameters(), config.learning_rate, eps=_ADAM_EPSILON, fused=True)
        self._targets: Tensor | None = None

    def start_equal(self) -> None:
        """Give all processes the first one's weights."""
        self.world.broadcast(list(self.model.state_dict().values()))

    def advantages(self, learner: Learner, rewards: Tensor, last: TensorDict) -> Tensor:
        """GAE of the stream, (T, n); stores the critic's targets for :meth:`update`."""
        with torch.no_grad():
            values = self.model(learner.storage.observations.flatten(0, 1)).view(rewards.shape)
            result = learner._gae(rewards, values, self.model(last)[:, 0])
        self._targets = (result + values).flatten().clone()
        return result

    def update(self, observations: TensorDict, learning_rate: float) -> float:
        """Mean-squared-error epochs over the rollout's observations (T·n,); returns the mean loss."""
        for group in self.optimizer.param_groups:
            group["lr"] = learning_rate
        if self._targets is None:
            return float("nan")
        losses: list[Tensor] = []
        count = self._targets.numel()
        for _ in range(self.config.epochs):
            for rows in torch.randperm(count).chunk(self.config.minibatches):
                loss = (self.model(observations[rows])[:, 0] - self._targets[rows]).square().mean()
                self.optimizer.zero_grad()
                loss.backward()
                if self.world.size > 1:
                    reduce_gradients_in_buckets(self.model.parameters(), self.world.size, _BUCKET_MB)
                nn.utils.clip_grad_norm_(self.model.parameters(), self.config.max_grad_norm)
                self.optimizer.step()
                losses.append(loss.detach())
        return float(torch.stack(losses).mean())

    def state_dict(self) -> dict[str, Any]:
        """Network and optimiser."""
        return {"model": self.model.state_dict(), "optimizer": self.optimizer.state_dict()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore the result of :meth:`state_dict`."""
        self.model.load_state_dict(state["model"])
        self.optimizer.load_state_dict(state["optimizer"])
