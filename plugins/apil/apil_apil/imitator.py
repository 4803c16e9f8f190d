"""The imitator π̃ of the victim: policy, critic, and their update by TRPO or PPO."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor, nn

from apil_apil.config import ImitatorConfig
from apil_apil.trpo import TrustRegion, trpo_step
from apil_core import (
    DiagonalGaussian,
    GaussianActor,
    ReturnNormalizer,
    gae,
    mlp,
    normalize_advantages,
)

_ADAM_EPSILON = 1e-5


@dataclass
class Experience:
    """What the imitator learns from in one iteration.

    Attributes:
        states: normalised, (T, n, s).
        next_states: after the last step, (n, s).
        actions: ã as drawn from the imitator, (T, n, a).
        rewards: η, (T, n).
        done: (T, n), bool.
    """

    states: Tensor
    next_states: Tensor
    actions: Tensor
    rewards: Tensor
    done: Tensor


class Imitator(nn.Module):
    """A Gaussian policy on the victim's (normalised) observation, with its own critic.

    Args:
        state_size, action_size: what it reads and predicts.
        config: layers and update settings.
    """

    def __init__(self, state_size: int, action_size: int, config: ImitatorConfig):
        super().__init__()
        self.config = config
        self.policy = GaussianActor(state_size, action_size, config.hidden, config.init_std)
        self.critic = mlp((state_size, *config.hidden, 1))
        self.scale: ReturnNormalizer | None = None
        self.optimizer = torch.optim.Adam(self.policy.parameters(), config.learning_rate, eps=_ADAM_EPSILON)
        self.value_optimizer = torch.optim.Adam(
            self.critic.parameters(), config.value_learning_rate, eps=_ADAM_EPSILON
        )

    def forward(self, states: Tensor) -> DiagonalGaussian:
        """Predicted distribution of the victim's action, for normalised states (…, s)."""
        distribution: DiagonalGaussian = self.policy(states)
        return distribution

    def learn(self, experience: Experience, generator: torch.Generator) -> dict[str, float]:
        """One policy-gradient update and the critic's passes; returns metrics."""
        config = self.config
        states = experience.states.flatten(0, 1)
        with torch.no_grad():
            rewards = self._scaled(experience.rewards, experience.done)
            values = self.critic(experience.states)[..., 0]
            last = self.critic(experience.next_states)[..., 0]
            advantages = gae(rewards, values, last, experience.done, gamma=config.gamma, lam=config.lam)
        targets = (advantages + values).flatten()
        actions = experience.actions.flatten(0, 1)
        scaled = normalize_advantages(advantages).flatten()
        update = self._trpo if config.update == "trpo" else self._ppo
        metrics = update(states, actions, scaled, generator)
        metrics["value_loss"] = self._fit_critic(states, targets, generator)
        return {f"imitator_{name}": value for name, value in metrics.items()}

    def _scaled(self, rewards: Tensor, done: Tensor) -> Tensor:
        """η in units of the running std of its discounted return, (T, n).

        A positive factor, so the policy's objective is the same; but log D adds up to about −100 over
        a game, which a critic that starts at 0 would take a hundred iterations to reach, and until
        then the advantage would mostly say how soon the game ends.
        """
        if self.scale is None:
            self.scale = ReturnNormalizer(rewards.shape[1], self.config.gamma, clip=float("inf"))
            self.scale.to(rewards.device)
        for reward, ended in zip(rewards, done, strict=True):
            self.scale.update(reward, ended)
        scaled: Tensor = self.scale(rewards)
        return scaled

    def _trpo(
        self, states: Tensor, actions: Tensor, advantages: Tensor, generator: torch.Generator
    ) -> dict[str, float]:
        config = self.config

        def surrogate(new: DiagonalGaussian, old: DiagonalGaussian) -> Tensor:
            gain = ((new.log_prob(actions) - old.log_prob(actions)).exp() * advantages).mean()
            return gain + config.entropy_coefficient * new.entropy().mean()

        region = TrustRegion(config.kl, config.cg_steps, config.damping, config.backtracks)
        rows = _permutation(len(states), generator)[: max(1, int(len(states) * config.fisher_fraction))]
        return trpo_step(self.policy, states, surrogate, region, rows)

    def _ppo(
        self, states: Tensor, actions: Tensor, advantages: Tensor, generator: torch.Generator
    ) -> dict[str, float]:
        config = self.config
        with torch.no_grad():
            before = self.policy(states)
            before = DiagonalGaussian(before.mean.clone(), before.std.clone())
            old = before.log_prob(actions)
        for _ in range(config.epochs):
            for rows in _permutation(len(states), generator).chunk(config.minibatches):
                new = self.policy(states.index_select(0, rows))
                ratio = (new.log_prob(actions[rows]) - old[rows]).exp()
                clipped = ratio.clamp(1 - config.clip, 1 + config.clip)
                gain = torch.min(ratio * advantages[rows], clipped * advantages[rows]).mean()
                loss = -gain - config.entropy_coefficient * new.entropy().mean()
                self._descend(loss, self.policy, self.optimizer)
        with torch.no_grad():
            return {"kl": float(before.kl(self.policy(states)).mean())}

    def _fit_critic(self, states: Tensor, targets: Tensor, generator: torch.Generator) -> float:
        losses = []
        for _ in range(self.config.value_epochs):
            for rows in _permutation(len(states), generator).chunk(self.config.minibatches):
                loss = (self.critic(states.index_select(0, rows))[..., 0] - targets[rows]).square().mean()
                self._descend(loss, self.critic, self.value_optimizer)
                losses.append(loss.detach())
        return float(torch.stack(losses).mean())

    def _descend(self, loss: Tensor, module: nn.Module, optimizer: torch.optim.Optimizer) -> None:
        optimizer.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(module.parameters(), self.config.max_grad_norm)
        optimizer.step()

    def training_state(self) -> dict[str, Any]:
        """Weights and optimisers."""
        return {
            "policy": self.policy.state_dict(),
            "critic": self.critic.state_dict(),
            "scale": None if self.scale is None else self.scale.state_dict(),
            "optimizer": self.optimizer.state_dict(),
            "value_optimizer": self.value_optimizer.state_dict(),
        }

    def load_training_state(self, state: dict[str, Any]) -> None:
        """Restore what :meth:`training_state` gave."""
        self.policy.load_state_dict(state["policy"])
        self.critic.load_state_dict(state["critic"])
        if state["scale"] is not None:
            self.scale = ReturnNormalizer(
                len(state["scale"]["returns"]), self.config.gamma, clip=float("inf")
            )
            self.scale.load_state_dict(state["scale"])
            self.scale.to(next(self.policy.parameters()).device)
        self.optimizer.load_state_dict(state["optimizer"])
        self.value_optimizer.load_state_dict(state["value_optimizer"])


def _permutation(count: int, generator: torch.Generator) -> Tensor:
    return torch.randperm(count, generator=generator, device=generator.device)
