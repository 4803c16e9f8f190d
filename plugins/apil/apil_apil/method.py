"""APIL's hooks: predict the victim's action, and train the imitator (Bui et al. 2022; docs/methods.md §2)."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor

from apil_apil.config import ApilConfig
from apil_apil.discriminator import REWARDS, Discriminator
from apil_apil.imitator import Experience, Imitator
from apil_apil.quality import accuracy, prediction_quality
from apil_core import (
    ApilError,
    ConfigError,
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

_ACCURACY_STEPS = 4
"""Steps for each one that D's accuracy is measured on: thousands of pairs are enough."""

DEFAULT_CREDIT = {"shared": "step", "own": "return"}
"""Default of ``imitator.credit``: only in the imitator's own games does ã_t affect later steps."""


@dataclass
class Games:
    """A rollout in the form read by imitator and D.

    Attributes:
        rollout: the games.
        states: normalised, (T, n, s).
        scored: those that D reads with the action of a step, (T, n, s).
        actions: of the victim, or of the imitator, (T, n, a).
    """

    rollout: Rollout
    states: Tensor
    scored: Tensor
    actions: Tensor


class Apil(Method):
    """Feeds ã^ν to the adversary; after each rollout updates D, then the imitator; PPO comes last."""

    options: ApilConfig

    def __init__(self, options: ApilConfig, setup: MethodSetup):
        super().__init__(options, setup)
        if options.rollouts == "own" and setup.ppo.num_steps < 2:
            raise ConfigError("ppo.num_steps: 1 leaves rollouts: own nothing to learn from; use 2 or more")
        sizes = {
            "victim": setup.victim.observation_size,
            "adversary": setup.adversary.observation_size,
        }
        sizes["both"] = sum(sizes.values())
        state_size, action_size = sizes[options.observes], setup.victim.action_size
        device = setup.device
        self.normalizer = ObservationNormalizer(state_size).to(device)
        per_step = (options.imitator.credit or DEFAULT_CREDIT[options.rollouts]) == "step"
        self.imitator = Imitator(
            state_size,
            action_size,
            options.imitator,
            per_step=per_step,
            stream_discount=(setup.ppo.gamma, setup.ppo.lam),
        ).to(device)
        self.discriminator = Discriminator(state_size, action_size, options.discriminator).to(device)
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
        """Input of imitator and D, before normalisation."""
        if self.options.observes == "victim":
            return victim_observation
        if self.options.observes == "adversary":
            return observation
        return torch.cat([victim_observation, observation], dim=-1)

    @hookimpl
    def update_auxiliary(self, run: Run, rollout: Rollout) -> Callable[[], dict[str, float]] | None:
        """D's cross-entropy, then the imitator's update, on this iteration's games; beside PPO's update."""
        if self.options.prediction == "noise":
            self.action_scale.update(rollout.victim_action.flatten(0, 1))
        if self.options.prediction != "imitator":
            return None
        raw = self._state(rollout.victim_observation, rollout.observation)
        fresh = bool(self.normalizer.moments.count == 0)
        if fresh:  # the first rollout was collected without statistics
            self.normalizer.update(raw.flatten(0, 1))
        states = self.normalizer(raw)
        victim = Games(rollout, states, self._scored(states, rollout), rollout.victim_action)
        own = self._own(run, victim, fresh)
        streams = self._streams(run, own.rollout)

        def learn() -> dict[str, float]:
            metrics = prediction_quality(self._distribution(states), rollout)
            metrics |= self._learn(run, victim, own, streams)
            if not fresh:
                self.normalizer.update(raw.flatten(0, 1))
            return metrics

        return learn

    def _learn(
        self, run: Run, victim: Games, own: Games, streams: Mapping[str, tuple[float, Tensor]]
    ) -> dict[str, float]:
        """Update D on the victim's and the imitator's actions, then the imitator; returns metrics.

        Args:
            run: the run.
            victim: games in which the victim acted.
            own: games the imitator learns from, and its actions.
            streams: rewards of the imitator besides D's.
        """
        metrics, logits = self._update_discriminator(run, victim, own)
        rewards = self._rewards(run, own.rollout, logits)
        paid = None if self.options.imitator.objective == "likelihood" else rewards
        if not self.imitator.per_step:
            for weight, reward in streams.values():
                paid = weight * reward + (0.0 if paid is None else paid)
            streams = {}
        metrics["imitation_reward"] = float((rewards if paid is None else paid).mean())
        played = own.rollout
        experience = Experience(
            own.states,
            self.normalizer(self._state(played.next_victim_observation, played.next_observation)),
            own.actions,
            played.done,
            victim.states.flatten(0, 1),
            victim.actions.flatten(0, 1),
            paid,
            streams,
            self._likelihood_weight(run.steps),
        )
        if experience.likelihood_weight:
            metrics["likelihood_weight"] = experience.likelihood_weight
        return metrics | self.imitator.learn(experience, run.generator)

    def _update_discriminator(self, run: Run, victim: Games, own: Games) -> tuple[dict[str, float], Tensor]:
        """D's passes; returns metrics, and its logits of the imitator's actions that are paid for, (T, n)."""
        shared = own.states is victim.states
        some = slice(None, None, _ACCURACY_STEPS)
        if shared:  # D's state layer is evaluated once
            told = self._logits(victim.scored[some], victim.actions[some], own.actions[some])
        else:
            told = self._logits(victim.scored[some], victim.actions[some])
            told += self._logits(own.scored[some], own.actions[some])
        metrics = accuracy(*told)
        collected = self.options.reward_time == "collected"
        before = self._logits(own.scored, own.actions) if collected else []
        real = victim.scored.flatten(0, 1), victim.actions.flatten(0, 1)
        states = real[0] if shared else own.scored.flatten(0, 1)
        fake = states, own.actions.flatten(0, 1)
        metrics["discriminator_loss"] = self.discriminator.fit(real, fake, self._passes(), run.generator)
        (logits,) = before or self._logits(own.scored, own.actions)
        return metrics, logits

    def _rewards(self, run: Run, played: Rollout, logits: Tensor) -> Tensor:
        """Rewards from the hook, (T, n), checked."""
        rewards: Tensor = run.hook.imitation_reward(run=run, rollout=played, logits=logits)
        if rewards.shape != logits.shape:
            got, want = tuple(rewards.shape), tuple(logits.shape)
            raise PluginError(f"imitation_reward must return shape {want}, got {got}")
        return rewards

    def _streams(self, run: Run, played: Rollout) -> dict[str, tuple[float, Tensor]]:
        """Further reward streams of the imitator, by name, checked; makes critics for new ones."""
        streams: dict[str, tuple[float, Tensor]] = {}
        for answer in run.hook.imitation_streams(run=run, rollout=played):
            try:
                named = {str(name): (float(weight), reward) for name, (weight, reward) in answer.items()}
            except (AttributeError, TypeError, ValueError) as error:
                form = "{name: (weight, reward)}"
                raise PluginError(f"imitation_streams must return {form} or None: {error}") from error
            for name, (weight, reward) in named.items():
                wrong = "is returned twice" if name in streams else _flaw(weight, reward, played.done)
                if wrong:
                    raise PluginError(f"imitation_streams: {name!r} {wrong}")
                streams[name] = weight, reward.detach()
        known = self.imitator.stream_critics
        if not run.iteration:  # they may be those of the run it was initialised from
            for name in known.keys() - streams.keys():
                del known[name]
        elif known and known.keys() != streams.keys():
            change = f"from {sorted(known)} to {sorted(streams)}"
            raise PluginError(f"imitation_streams: names changed {change}; give the same in every rollout")
        for name in streams if self.imitator.per_step else ():
            self.imitator.open_stream(name, run.config.seed)
        return streams

    def _likelihood_weight(self, steps: int) -> float:
        """Weight of the log-likelihood after ``steps`` environment steps, by ``imitator.objective``."""
        config = self.options.imitator
        if config.objective != "both":
            return 1.0 if config.objective == "likelihood" else 0.0
        falling = config.likelihood_weight * 0.5 ** (steps / config.likelihood_half_life)
        return max(falling, config.likelihood_floor)

    def _passes(self) -> tuple[int, int]:
        """Epochs and minibatches of D."""
        own, ppo = self.options.discriminator, self.setup.ppo
        return own.epochs or ppo.epochs, own.minibatches or ppo.minibatches

    @hookimpl
    def imitation_reward(self, logits: Tensor) -> Tensor:
        """log D(s, ã), −log(1 − D) as the published code has it, or their sum; shape (T, n)."""
        return REWARDS[self.options.reward](logits)

    def _own(self, run: Run, victim: Games, fresh: bool) -> Games:
        """The games the imitator learns from, with ã.

        Shared: the victim's games, ã as the adversary saw it, redrawn where that was no sample of the current
        policy. Own: further games with the imitator in the victim's seat.
        """
        if self.options.rollouts == "own":
            # its first row was drawn before the imitator's last update
            played = run.collect(ImitatorPolicy(self), run.config.ppo.num_steps).after(1)
            states = self.normalizer(self._state(played.victim_observation, played.observation))
            return Games(played, states, self._scored(states, played), played.victim_action)
        if fresh or self.options.prediction_actions == "mode":
            actions = self._distribution(victim.states).sample(run.generator)
        else:
            # the first row was drawn before the last update: redraw it from the current policy
            actions = victim.rollout.groups[PREDICTION].clone()
            actions[0] = self._distribution(victim.states[0]).sample(run.generator)
        return replace(victim, actions=actions)

    def _scored(self, states: Tensor, rollout: Rollout) -> Tensor:
        """States D reads with a_t: s_t, or s_{t+1} as the published code has it; (T, n, s)."""
        if self.options.discriminator.state == "current":
            return states
        last = self._state(rollout.next_victim_observation, rollout.next_observation)
        return torch.cat([states[1:], self.normalizer(last).unsqueeze(0)])

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
            "discriminator_optimizer": self.discriminator.optimizer.state_dict(),
            "normalizer": self.normalizer.state_dict(),
            "action_scale": self.action_scale.state_dict(),
        }

    def acting_state_dict(self) -> dict[str, Any]:
        """See :meth:`apil_core.Method.acting_state_dict`."""
        return {"acting": {name: module.state_dict() for name, module in self._acting().items()}}

    def _acting(self) -> dict[str, torch.nn.Module]:
        return {
            "policy": self.imitator.policy,
            "normalizer": self.normalizer,
            "action_scale": self.action_scale,
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """See :meth:`apil_core.Method.load_state_dict`."""
        if "acting" in state:
            for name, module in self._acting().items():
                module.load_state_dict(state["acting"][name])
            return
        self.imitator.load_training_state(state["imitator"])
        self.discriminator.load_state_dict(state["discriminator"])
        self.discriminator.optimizer.load_state_dict(state["discriminator_optimizer"])
        self.normalizer.load_state_dict(state["normalizer"])
        self.action_scale.load_state_dict(state["action_scale"])


def _flaw(weight: float, reward: object, done: Tensor) -> str:
    """Reason why a stream cannot be learnt from, or ``""``; ``done`` has the shape it must have."""
    if not isinstance(reward, Tensor):
        return f"must have a tensor as its reward, got {type(reward).__name__}"
    if reward.shape != done.shape or reward.dtype != torch.float32 or reward.device != done.device:
        got = f"{tuple(reward.shape)} {reward.dtype} on {reward.device}"
        return f"must be {tuple(done.shape)} torch.float32 on {done.device}, got {got}"
    finite = math.isfinite(weight) and bool(torch.isfinite(reward).all())
    return "" if finite else "has a weight or rewards that are NaN or infinite"


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
