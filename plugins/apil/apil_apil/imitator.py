"""The imitator π̃ of the victim: its policy, and the update by TRPO or PPO (docs/methods.md §2)."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import torch
from torch import Tensor, nn

from apil_apil.config import ImitatorConfig
from apil_apil.critic import ADAM_EPSILON, Critic, batches, descend
from apil_apil.trpo import TrustRegion, trpo_step
from apil_core import (
    DiagonalGaussian,
    GaussianActor,
    ReturnNormalizer,
    normalize_advantages,
    side_by_side,
)


@dataclass
class Experience:
    """Data of one update of the imitator.

    Attributes:
        states: normalised, (T, n, s).
        next_states: after the last step, (n, s).
        actions: ã as drawn from the imitator, (T, n, a).
        done: (T, n), bool.
        victim_states, victim_actions: the victim's states and its actions there, (m, s), (m, a); m ≥ T·n.
        rewards: of D, (T, n); ``None``: D gives no reward.
        streams: further rewards, discounted: name → (weight, (T, n)).
        likelihood_weight: of the victim's mean log-likelihood in the objective.
    """

    states: Tensor
    next_states: Tensor
    actions: Tensor
    done: Tensor
    victim_states: Tensor
    victim_actions: Tensor
    rewards: Tensor | None
    streams: Mapping[str, tuple[float, Tensor]] = field(default_factory=dict)
    likelihood_weight: float = 0.0


class Imitator(nn.Module):
    """A Gaussian policy on the victim's (normalised) observation, with a critic for each of its rewards.

    Args:
        state_size, action_size: sizes of its input and output.
        config: layers and update settings.
        per_step: ``credit: step``, D rewards ã_t for its own step alone.
        stream_discount: γ and λ of the further reward streams.
    """

    def __init__(
        self,
        state_size: int,
        action_size: int,
        config: ImitatorConfig,
        *,
        per_step: bool,
        stream_discount: tuple[float, float],
    ):
        super().__init__()
        self.config = config
        self.per_step = per_step
        self.stream_discount = stream_discount
        self.state_size = state_size
        self.policy = GaussianActor(state_size, action_size, config.hidden, config.init_std)
        self.critic = Critic(state_size, config)
        self.scale: ReturnNormalizer | None = None
        self.optimizer = torch.optim.Adam(
            self.policy.parameters(), config.learning_rate, eps=ADAM_EPSILON, fused=True
        )
        self.stream_critics: dict[str, Critic] = {}  # any name will do

    def forward(self, states: Tensor) -> DiagonalGaussian:
        """Predicted distribution of the victim's action, for normalised states (…, s)."""
        distribution: DiagonalGaussian = self.policy(states)
        return distribution

    def open_stream(self, name: str, seed: int = 0) -> None:
        """Create a reward stream's critic if there is none, its weights from a separate random stream."""
        if name in self.stream_critics:
            return
        device = self.policy.log_std.device
        with torch.random.fork_rng(devices=[device] if device.type == "cuda" else []):
            torch.manual_seed(zlib.crc32(f"{seed} {name}".encode()))
            self.stream_critics[name] = Critic(self.state_size, self.config).to(device)

    def learn(self, experience: Experience, generator: torch.Generator) -> dict[str, float]:
        """One update of the policy and the passes of its critics; returns metrics."""
        advantages = self.advantages(experience)
        if advantages is not None:
            advantages = advantages.flatten()
        states = experience.states.flatten(0, 1)
        update, passes = (self._trpo, (1, 1)) if self.config.update == "trpo" else (self._ppo, self._passes)
        parts = batches(len(states), *passes, generator)
        critics = {f"value_loss_{name}": self.stream_critics[name] for name in experience.streams}
        if experience.rewards is not None:
            critics = {"value_loss": self.critic, **critics}
        fits = {name: (critic, critic.batches(len(states), generator)) for name, critic in critics.items()}
        moved, losses = side_by_side(
            lambda: update(experience, advantages, parts),
            lambda: {name: critic.fit(states, rows) for name, (critic, rows) in fits.items()},
        )
        return {f"imitator_{name}": value for name, value in {**moved, **losses}.items()}

    @property
    def _passes(self) -> tuple[int, int]:
        return self.config.epochs, self.config.minibatches

    def advantages(self, experience: Experience) -> Tensor | None:
        """Weights of log π̃(ã) in the policy gradient, (T, n); ``None`` if there is no reward for ã.

        z(A_D) + Σ weight · z(A_stream), z to mean 0 and standard deviation 1 over the rollout. A_D is
        D's reward less its expectation V(s) (``credit: step``), or GAE of its return.
        """
        parts = []
        if experience.rewards is not None:
            gamma, lam = (0.0, 0.0) if self.per_step else (self.config.gamma, self.config.lam)
            rewards = experience.rewards if self.per_step else self._scaled(experience)
            parts.append(_normalized(self.critic, experience, rewards, gamma, lam))
        for name, (weight, rewards) in experience.streams.items():
            critic = self.stream_critics[name]
            parts.append(weight * _normalized(critic, experience, rewards, *self.stream_discount))
        return torch.stack(parts).sum(0) if parts else None

    def _scaled(self, experience: Experience) -> Tensor:
        """η in units of the running std of its discounted return, (T, n).

        A positive factor, so the policy's objective is the same; but log D adds up to about −100 over
        a game, which a critic that starts at 0 would take a hundred iterations to reach, and until
        then the advantage would mostly say how soon the game ends.
        """
        rewards, done = experience.rewards, experience.done
        assert rewards is not None
        if self.scale is None:
            self.scale = ReturnNormalizer(rewards.shape[1], self.config.gamma, clip=float("inf"))
            self.scale.to(rewards.device)
        for reward, ended in zip(rewards, done, strict=True):
            self.scale.update(reward, ended)
        scaled: Tensor = self.scale(rewards)
        return scaled

    def _trpo(
        self, experience: Experience, advantages: Tensor | None, parts: list[Tensor]
    ) -> dict[str, float]:
        config = self.config
        states, actions = experience.states.flatten(0, 1), experience.actions.flatten(0, 1)

        def surrogate(new: DiagonalGaussian, old: DiagonalGaussian) -> Tensor:
            gain = config.entropy_coefficient * new.entropy().mean()
            if advantages is not None:
                ratio = (new.log_prob(actions) - old.log_prob(actions)).exp()
                gain = (ratio * advantages).mean() + gain
            return gain + self._likelihood(experience) if experience.likelihood_weight else gain

        region = TrustRegion(config.kl, config.cg_steps, config.damping, config.backtracks)
        rows = parts[0][: max(1, int(len(states) * config.fisher_fraction))]
        return trpo_step(self.policy, states, surrogate, region, rows)

    def _ppo(
        self, experience: Experience, advantages: Tensor | None, parts: list[Tensor]
    ) -> dict[str, float]:
        config = self.config
        states, actions = experience.states.flatten(0, 1), experience.actions.flatten(0, 1)
        with torch.no_grad():
            before = self.policy(states)
            before = DiagonalGaussian(before.mean.clone(), before.std.clone())
            old = before.log_prob(actions)
        for rows in parts:
            new = self.policy(states.index_select(0, rows))
            loss = -config.entropy_coefficient * new.entropy().mean()
            if advantages is not None:
                ratio = (new.log_prob(actions[rows]) - old[rows]).exp()
                clipped = ratio.clamp(1 - config.clip, 1 + config.clip)
                loss = loss - torch.min(ratio * advantages[rows], clipped * advantages[rows]).mean()
            if experience.likelihood_weight:
                loss = loss - self._likelihood(experience, rows)
            descend(loss, self.policy, self.optimizer, config.max_grad_norm)
        with torch.no_grad():
            return {"kl": float(before.kl(self.policy(states)).mean())}

    def _likelihood(self, experience: Experience, rows: Tensor | None = None) -> Tensor:
        """Weighted mean log-likelihood of the victim's actions, all or some of them, ()."""
        states, actions = experience.victim_states, experience.victim_actions
        if rows is not None:
            states, actions = states.index_select(0, rows), actions[rows]
        return experience.likelihood_weight * self.policy(states).log_prob(actions).mean()

    def training_state(self) -> dict[str, Any]:
        """Weights and optimisers."""
        return {
            "policy": self.policy.state_dict(),
            "scale": None if self.scale is None else self.scale.state_dict(),
            "optimizer": self.optimizer.state_dict(),
            "streams": {name: critic.training_state() for name, critic in self.stream_critics.items()},
            **self.critic.training_state(),
        }

    def load_training_state(self, state: dict[str, Any]) -> None:
        """Restore the result of :meth:`training_state`."""
        self.policy.load_state_dict(state["policy"])
        self.critic.load_training_state(state)
        if state["scale"] is not None:
            self.scale = ReturnNormalizer(
                len(state["scale"]["returns"]), self.config.gamma, clip=float("inf")
            )
            self.scale.load_state_dict(state["scale"])
            self.scale.to(self.policy.log_std.device)
        self.optimizer.load_state_dict(state["optimizer"])
        for name, critic in state.get("streams", {}).items():  # older ones have none
            self.open_stream(name)
            self.stream_critics[name].load_training_state(critic)


def _normalized(critic: Critic, experience: Experience, rewards: Tensor, gamma: float, lam: float) -> Tensor:
    """Advantages of ``rewards`` at mean 0 and standard deviation 1 over the rollout, (T, n)."""
    advantages = critic.advantages(
        experience.states, experience.next_states, rewards, experience.done, gamma=gamma, lam=lam
    )
    return normalize_advantages(advantages)
