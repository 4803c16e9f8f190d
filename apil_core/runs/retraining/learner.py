"""PPO for a victim's own network, with or without memory.

The adversaries' learner (:mod:`.training.ppo`) stands on rsl_rl, whose models are its own; a victim is a
given network, and with an LSTM needs gradients through time. The settings and what they mean are the same:
:class:`apil_core.api.config.PPOConfig`, docs/methods.md §3.

A recurrent victim learns from whole stretches: each minibatch is some of the games over all T steps, begun
from the memory the game had when the rollout began (of the network before the update), cleared where games
end. Gradients reach back to the start of the rollout and no further.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import torch
from torch import Tensor, nn

from apil_core.api.config import PPOConfig
from apil_core.api.types import DiagonalGaussian
from apil_core.common.errors import ApilError
from apil_core.policies.network import LstmState
from apil_core.runs.retraining.network import Critic, VictimNetwork
from apil_core.runs.retraining.rollout import Piece, VictimRollout
from apil_core.training.returns import gae, normalize_advantages

_ADAM_EPSILON = 1e-5


class VictimLearner:
    """The victim's network, its critic, their optimisers, and what was played since the last update.

    Args:
        network: the victim.
        critic: gives values in units of normalised rewards.
        config: PPO's settings; ``hidden``, ``init_std`` and ``observation_clip`` are the network's own.
        games: played together.
        freeze_critic: never train it.
        generators: ``"victim"`` draws actions, ``"order"`` (on the CPU) minibatches.
    """

    def __init__(
        self,
        network: VictimNetwork,
        critic: Critic,
        config: PPOConfig,
        games: int,
        *,
        freeze_critic: bool,
        generators: dict[str, torch.Generator],
    ):
        self.network = network
        self.critic = critic
        self.config = config
        self.freeze_critic = freeze_critic
        self.generators = generators
        kind = torch.optim.AdamW if config.optimizer == "adamw" else torch.optim.Adam
        self._optimizers = {
            "victim": kind(network.parameters(), config.learning_rate, eps=_ADAM_EPSILON),
            "critic": kind(critic.parameters(), config.learning_rate, eps=_ADAM_EPSILON),
        }
        shape = network.shape
        self._memory = network.body.zero_state(games)
        self._critic_memory = critic.body.zero_state(games)
        sizes = (games, shape.observation_size, shape.action_size)
        self.rollout = VictimRollout.empty(config.num_steps, self._memory, sizes)
        self._nobody = torch.zeros(1, games, dtype=torch.bool, device=network.log_std.device)

    @torch.no_grad()
    def act(self, observation: Tensor) -> Tensor:
        """Draw actions for (n, o) observations, (n, a), and remember what the update needs."""
        rollout, t = self.rollout, self.rollout.filled
        if t == 0:
            rollout.actor_memory, rollout.critic_memory = self._memory, self._critic_memory
        z = self.network.standardise(observation)
        mean, self._memory = self.network(z.unsqueeze(0), self._nobody, self._memory)
        action = DiagonalGaussian(mean[0], self.network.log_std.exp()).sample(self.generators["victim"])
        rollout.z[t], rollout.mean[t], rollout.action[t] = z, mean[0], action
        return action

    def record(self, reward: Tensor, done: Tensor) -> None:
        """How the step that :meth:`act` began went: normalised reward (n,), end flags (n,)."""
        self.rollout.record(reward, done)
        if self.network.recurrent and bool(done.any()):
            h, c = (rows.masked_fill(done.unsqueeze(1), 0) for rows in self._memory)
            self._memory = h, c

    def forget(self) -> None:
        """Drop the rollout unseen; what the victim remembers of its games stays."""
        rollout = self.rollout
        with torch.no_grad():
            _, self._critic_memory = self.critic(rollout.z, rollout.done, self._critic_memory)
        rollout.filled = 0

    @torch.no_grad()
    def estimate(self, last: Tensor) -> dict[str, float]:
        """Values, advantages and targets of the rollout, once for all epochs.

        Args:
            last: observations after the last step, (n, o).

        Returns:
            ``ppo/explained_variance``: share of the returns' variance that the critic foresaw.
        """
        rollout, config = self.rollout, self.config
        value, memory = self.critic(rollout.z, rollout.done, self._critic_memory)
        self._critic_memory = memory
        z = self.network.standardise(last).unsqueeze(0)
        following, _ = self.critic(z, self._nobody, memory)
        advantage = gae(rollout.reward, value, following[0], rollout.done, gamma=config.gamma, lam=config.lam)
        rollout.value, rollout.advantage, rollout.target = value, advantage, advantage + value
        rollout.log_prob = self._before().log_prob(rollout.action)
        spread = float(rollout.target.var())
        unforeseen = float(advantage.var()) / spread if spread else math.nan
        return {"ppo/explained_variance": 1 - unforeseen}

    def _before(self) -> DiagonalGaussian:
        return DiagonalGaussian(self.rollout.mean, self.network.log_std.detach().exp())

    def update(self, learning_rate: float, *, critic_only: bool = False) -> dict[str, float]:
        """PPO's epochs over the rollout, which is empty afterwards.

        Args:
            learning_rate: for this iteration.
            critic_only: leave the victim as it is.

        Raises:
            ApilError: the victim became NaN or infinite.
        """
        before = self._before()
        losses = [self._learn(p, learning_rate, critic_only=critic_only) for p in self._pieces()]
        means = torch.stack(losses).mean(0).tolist()
        metrics = dict(zip(("ppo/surrogate", "ppo/value", "ppo/clipped"), means, strict=True))
        with torch.no_grad():
            rollout = self.rollout
            mean, _ = self.network(rollout.z, rollout.done, rollout.actor_memory)
            after = DiagonalGaussian(mean, self.network.log_std.exp())
            metrics |= {"ppo/kl": float(before.kl(after).mean()), "ppo/std": float(after.std.mean())}
        self.rollout.filled = 0
        if not math.isfinite(metrics["ppo/kl"] + metrics["ppo/value"]):
            raise ApilError(
                f"the victim became NaN or infinite in this update (ppo.learning_rate {learning_rate:g}); "
                "lower the learning rate and resume from the last checkpoint"
            )
        return {**metrics, "ppo/learning_rate": learning_rate}

    def _pieces(self) -> Iterator[Piece]:
        config, order = self.config, self.generators["order"]
        for _ in range(config.epochs):
            if self.network.recurrent or self.critic.recurrent:
                yield from self.rollout.games(config.minibatches, order)
            else:
                yield from self.rollout.steps(config.minibatches, order, self.network.body.zero_state(1))

    def _learn(self, piece: Piece, learning_rate: float, *, critic_only: bool) -> Tensor:
        """One gradient step of both networks; surrogate and value loss and share of clipped ratios, (3,)."""
        policy, clipped = torch.zeros((), device=piece.z.device), torch.zeros((), device=piece.z.device)
        if not critic_only:
            policy, clipped = self._surrogate(piece)
            self._step("victim", policy, learning_rate)
        value = self._value_loss(piece)
        if not self.freeze_critic:
            self._step("critic", 0.5 * self.config.value_coefficient * value, learning_rate)
        return torch.stack((policy.detach(), value.detach(), clipped))

    def _surrogate(self, piece: Piece) -> tuple[Tensor, Tensor]:
        config = self.config
        mean, _ = self.network(piece.z, piece.done, piece.actor_memory)
        present = DiagonalGaussian(mean, self.network.log_std.exp())
        ratio = (present.log_prob(piece.action) - piece.log_prob).exp()
        advantage = normalize_advantages(piece.advantage)
        bounded = ratio.clamp(1 - config.clip, 1 + config.clip)
        loss = -torch.minimum(ratio * advantage, bounded * advantage).mean()
        if config.entropy_coefficient:
            loss = loss - config.entropy_coefficient * present.entropy().mean()
        return loss, (ratio.detach() != bounded.detach()).float().mean()

    def _value_loss(self, piece: Piece) -> Tensor:
        with torch.set_grad_enabled(not self.freeze_critic):
            value, _ = self.critic(piece.z, piece.done, piece.critic_memory)
        near = piece.value + (value - piece.value).clamp(-self.config.clip, self.config.clip)
        errors = torch.maximum((value - piece.target).square(), (near - piece.target).square())
        return errors.mean()

    def _step(self, which: str, loss: Tensor, learning_rate: float) -> None:
        optimizer = self._optimizers[which]
        optimizer.param_groups[0]["lr"] = learning_rate
        optimizer.zero_grad(set_to_none=True)
        loss.backward()
        module = self.network if which == "victim" else self.critic
        nn.utils.clip_grad_norm_(module.parameters(), self.config.max_grad_norm)
        optimizer.step()

    def state_dict(self) -> dict[str, Any]:
        """Networks, optimisers and memories at an iteration boundary."""
        return {
            "network": self.network.state_dict(),
            "critic": self.critic.state_dict(),
            "optimizers": {name: each.state_dict() for name, each in self._optimizers.items()},
            "memory": list(self._memory),
            "critic_memory": list(self._critic_memory),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore what :meth:`state_dict` gave."""
        self.network.load_state_dict(state["network"])
        self.critic.load_state_dict(state["critic"])
        for name, optimizer in self._optimizers.items():
            optimizer.load_state_dict(state["optimizers"][name])
        device = self.network.log_std.device
        self._memory, self._critic_memory = (
            _memory(state[key], device) for key in ("memory", "critic_memory")
        )


def _memory(rows: list[Tensor], device: torch.device) -> LstmState:
    h, c = (row.to(device) for row in rows)
    return h, c
