"""APIL's hooks: predict the victim, and train who predicts it (Bui et al. 2022; docs/methods.md §2)."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from apil_apil.config import ApilConfig
from apil_apil.discriminator import Discriminator, imitation_loss, reward_log_d, reward_neg_log_1md
from apil_apil.imitator import Experience, Imitator
from apil_apil.quality import accuracy, prediction_quality
from apil_core import (
    ApilError,
    Context,
    Decision,
    DiagonalGaussian,
    Method,
    MethodSetup,
    ObservationNormalizer,
    PluginError,
    Policy,
    PolicyInfo,
    Rollout,
    Run,
    View,
    hookimpl,
)

PREDICTION = "prediction"
"""Observation group with ã."""


class Apil(Method):
    """Feeds ã^ν to the adversary; after each rollout updates D, then the imitator; PPO comes last."""

    options: ApilConfig

    def __init__(self, options: ApilConfig, setup: MethodSetup):
        super().__init__(options, setup)
        sizes = {
            "victim": setup.victim.observation_size,
            "adversary": setup.adversary.observation_size,
        }
        sizes["both"] = sum(sizes.values())
        state_size, action_size = sizes[options.observes], setup.victim.action_size
        device = setup.device
        self.normalizer = ObservationNormalizer(state_size).to(device)
        self.imitator = Imitator(state_size, action_size, options.imitator).to(device)
        self.discriminator = Discriminator(state_size, action_size, options.discriminator).to(device)
        self.discriminator_optimizer = torch.optim.Adam(
            self.discriminator.parameters(), options.discriminator.learning_rate
        )
        self.action_scale = ObservationNormalizer(action_size).to(device)

    @hookimpl
    def extend_observation(self, context: Context, view: View) -> dict[str, Tensor] | None:
        """ã^ν (n, a^ν), and the victim's observation if shared; nothing for other roles."""
        if context.role != "adversary":
            return None
        groups = {}
        if self.options.prediction != "none":
            groups[PREDICTION] = self._predict(context, view)
        if self.options.share_victim_observation:
            groups["victim_observation"] = view.opponent
        return groups

    def _predict(self, context: Context, view: View) -> Tensor:
        if self.options.prediction == "oracle":
            if view.opponent_action is None:
                raise ApilError("apil.prediction: oracle needs a victim that acts before the adversary")
            return view.opponent_action
        if self.options.prediction == "noise":
            shape = (view.own.shape[0], self.setup.victim.action_size)
            noise = torch.randn(shape, generator=context.generator, device=context.device)
            return noise / self.action_scale.scale
        distribution = self.imitator(self.normalizer(self._state(view.opponent, view.own)))
        sampled = self.options.prediction_actions == "sampled" and context.mode == "train"
        return distribution.sample(context.generator) if sampled else distribution.mean

    def _state(self, victim_observation: Tensor, observation: Tensor) -> Tensor:
        """What imitator and D read, before normalisation."""
        if self.options.observes == "victim":
            return victim_observation
        if self.options.observes == "adversary":
            return observation
        return torch.cat([victim_observation, observation], dim=-1)

    @hookimpl
    def update_auxiliary(self, run: Run, rollout: Rollout) -> dict[str, float] | None:
        """D's cross-entropy, then the imitator's policy gradient, on this iteration's games."""
        if self.options.prediction == "noise":
            self.action_scale.update(rollout.victim_action.flatten(0, 1))
        if self.options.prediction != "imitator":
            return None
        fresh = bool(self.normalizer.moments.count == 0)
        raw = self._state(rollout.victim_observation, rollout.observation)
        if fresh:  # the first rollout was played without statistics
            self.normalizer.update(raw.flatten(0, 1))
        states = self.normalizer(raw)
        victim_states, victim_actions = self._scored(states, rollout), rollout.victim_action
        metrics = prediction_quality(self._distribution(states), victim_actions)
        played, played_states, actions = self._own(run, rollout, states, fresh)
        shared = played is rollout
        scored = victim_states if shared else self._scored(played_states, played)
        if shared:
            victim_logits, old_logits = self._logits(scored, victim_actions, actions)
        else:
            (victim_logits,) = self._logits(victim_states, victim_actions)
            (old_logits,) = self._logits(scored, actions)
        metrics.update(accuracy(victim_logits, old_logits))
        metrics["discriminator_loss"] = self._update_discriminator(
            run, (victim_states, victim_actions), (scored, actions), shared
        )
        logits = old_logits if self.options.reward_time == "collected" else self._logits(scored, actions)[0]
        rewards = run.hook.imitation_reward(run=run, rollout=played, logits=logits)
        if rewards.shape != logits.shape:
            got, want = tuple(rewards.shape), tuple(logits.shape)
            raise PluginError(f"imitation_reward must return shape {want}, got {got}")
        metrics["imitation_reward"] = float(rewards.mean())
        following = self.normalizer(self._state(played.next_victim_observation, played.next_observation))
        experience = Experience(played_states, following, actions, rewards, played.done)
        metrics.update(self.imitator.learn(experience, run.generator))
        if not fresh:
            self.normalizer.update(raw.flatten(0, 1))
        return metrics

    @hookimpl
    def imitation_reward(self, logits: Tensor) -> Tensor:
        """log D(s, ã), or −log(1 − D) as the published code has it; shape (T, n)."""
        reward = reward_log_d if self.options.reward == "log_d" else reward_neg_log_1md
        return reward(logits)

    def _own(self, run: Run, rollout: Rollout, states: Tensor, fresh: bool) -> tuple[Rollout, Tensor, Tensor]:
        """The rollout the imitator learns from, its normalised states, and ã in it.

        Shared: ã as the adversary saw it, redrawn where that was no sample of the present policy.
        Own: further games with the imitator in the victim's seat.
        """
        if self.options.rollouts == "own":
            played = run.collect(ImitatorPolicy(self), run.config.ppo.num_steps)
            played_states = self.normalizer(self._state(played.victim_observation, played.observation))
            return played, played_states, played.victim_action
        if fresh or self.options.prediction_actions == "mode":
            return rollout, states, self._distribution(states).sample(run.generator)
        # the first row was drawn before the last update: draw it anew, from the present policy
        actions = rollout.groups[PREDICTION].clone()
        actions[0] = self._distribution(states[0]).sample(run.generator)
        return rollout, states, actions

    def _scored(self, states: Tensor, rollout: Rollout) -> Tensor:
        """States D reads with a_t: s_t, or s_{t+1} as the published code has it; (T, n, s)."""
        if self.options.discriminator.state == "current":
            return states
        last = self._state(rollout.next_victim_observation, rollout.next_observation)
        return torch.cat([states[1:], self.normalizer(last).unsqueeze(0)])

    def _update_discriminator(
        self, run: Run, victim: tuple[Tensor, Tensor], imitator: tuple[Tensor, Tensor], shared: bool
    ) -> float:
        """As many steps as PPO takes minibatches; returns the mean loss."""
        ppo = run.config.ppo
        flat = [tensor.flatten(0, 1) for tensor in (*victim, *imitator)]
        losses = []
        for _ in range(ppo.epochs):
            order = torch.randperm(len(flat[0]), generator=run.generator, device=run.device)
            for rows in order.chunk(ppo.minibatches):
                states, actions = flat[0].index_select(0, rows), flat[1][rows]
                if shared:
                    real, fake = self.discriminator.logits(states, actions, flat[3][rows])
                else:
                    (real,) = self.discriminator.logits(states, actions)
                    (fake,) = self.discriminator.logits(flat[2][rows], flat[3][rows])
                loss = imitation_loss(real, fake)
                self.discriminator_optimizer.zero_grad()
                loss.backward()
                self.discriminator_optimizer.step()
                losses.append(loss.detach())
        return float(torch.stack(losses).mean())

    @torch.no_grad()
    def _distribution(self, states: Tensor) -> DiagonalGaussian:
        return self.imitator(states)

    @torch.no_grad()
    def _logits(self, states: Tensor, *actions: Tensor) -> list[Tensor]:
        return self.discriminator.logits(states, *actions)

    def state_dict(self) -> dict[str, Any]:
        """See :meth:`apil_core.Method.state_dict`."""
        return {
            "imitator": self.imitator.training_state(),
            "discriminator": self.discriminator.state_dict(),
            "discriminator_optimizer": self.discriminator_optimizer.state_dict(),
            "normalizer": self.normalizer.state_dict(),
            "action_scale": self.action_scale.state_dict(),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """See :meth:`apil_core.Method.load_state_dict`."""
        self.imitator.load_training_state(state["imitator"])
        self.discriminator.load_state_dict(state["discriminator"])
        self.discriminator_optimizer.load_state_dict(state["discriminator_optimizer"])
        self.normalizer.load_state_dict(state["normalizer"])
        self.action_scale.load_state_dict(state["action_scale"])


class ImitatorPolicy(Policy):
    """The imitator in the victim's seat (``rollouts: own``)."""

    def __init__(self, method: Apil):
        self._method = method
        seat = method.setup.victim
        self.info = PolicyInfo("apil:imitator", "in memory", seat.observation_size, seat.action_size)

    def act(
        self,
        view: View,
        *,
        sample: bool,
        generator: torch.Generator | None = None,
        activations: bool = False,
    ) -> Decision:
        """Draw ã (always: its policy gradient needs samples); see :meth:`apil_core.Policy.act`."""
        method = self._method
        states = method.normalizer(method._state(view.own, view.opponent))
        distribution = method._distribution(states)
        return Decision(distribution.sample(generator), distribution)
