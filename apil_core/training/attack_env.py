"""The learner's environment: games with the frozen victim inside. Has the interface of rsl_rl's ``VecEnv``.

One step: victim and adversary have seen s_t, the victim has chosen a^ν_t, the adversary's extra
observations are made (they may read a^ν_t: the oracle), then :meth:`AttackEnv.step` takes a^α_t.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import torch
from tensordict import TensorDict
from torch import Tensor

from apil_core.api.config import RunConfig
from apil_core.api.game import Game, GameStep
from apil_core.api.policy import Policy
from apil_core.api.specs import RewardWeights
from apil_core.api.types import (
    PRIVILEGED_GROUP,
    Context,
    Decision,
    DiagonalGaussian,
    Rollout,
    StepBatch,
    View,
)
from apil_core.common.errors import PluginError
from apil_core.common.tensors import all_finite
from apil_core.games.two_players import TwoPlayerGames
from apil_core.plugins.hook_manager import RunHookManager
from apil_core.training.adversary import ObservationBuilder
from apil_core.training.episode_stats import EpisodeStats
from apil_core.training.normalize import ObservationNormalizer, ReturnNormalizer
from apil_core.training.observation_filter import ObservationFilter
from apil_core.training.rewards import dense_share, training_reward
from apil_core.training.rollout_buffer import RolloutBuffer

_OWN_TERMS = {"adversary", "victim", "uneven_share", "relabelled"}
"""Names under ``reward/`` in the metrics that plugins cannot use."""
_NORMALIZED = ("shaped", "adversary", "victim")
"""Rewards with a normaliser each."""


@dataclass
class Pending:
    """State between two steps: the victim has acted, the adversary has not.

    Attributes:
        view: the adversary's, with the action the victim has chosen.
        victim: that action and its distribution; ``None`` where it acts after the adversary.
        groups: raw observation groups of the adversary, each (n, k).
        observations: the same normalised, and the critics' own.
    """

    view: View
    victim: Decision | None
    groups: dict[str, Tensor]
    observations: TensorDict


class AttackEnv:
    """A batch of games, the victim in one seat and the learner in the other.

    Args:
        game: stepped here and nowhere else.
        victim: frozen policy.
        builder: of the adversary's observations; its statistics are updated only if ``learning``.
        hooks: called for filters, extra observations and reward terms.
        config: the run's.
        weights: of the training reward.
        adversary_side: index of the learner's seat.
        generators: ``"victim"`` for its actions, ``"method"`` for hooks.
        learning: false for side games of ``run.collect``: no statistics, no reward terms.
        victim_answers: the victim acts after the learner, and sees its action (retraining, where the frozen
            policy is an adversary).
    """

    def __init__(
        self,
        game: Game,
        victim: Policy,
        builder: ObservationBuilder,
        hooks: RunHookManager,
        config: RunConfig,
        *,
        weights: RewardWeights,
        adversary_side: int,
        generators: Mapping[str, torch.Generator],
        learning: bool = True,
        victim_answers: bool = False,
    ):
        self.game = game
        self.victim = victim
        self.builder = builder
        self.hooks = hooks
        self.config = config
        self.weights = weights
        self.side = adversary_side
        self.generators = generators
        self.learning = learning
        self.victim_answers = victim_answers
        self.device = torch.device(config.device)
        self.num_envs = game.num_envs
        self.num_actions = game.layout.sides[adversary_side].action_size
        self.max_episode_length = game.layout.max_steps
        self.episode_length_buf = torch.zeros(self.num_envs, dtype=torch.long, device=self.device)
        self.cfg: dict[str, Any] = config.model_dump(mode="json")
        self.steps = 0
        self.played: Callable[[], int] = lambda: self.steps
        """Steps of the whole run, by which the dense reward is annealed; set by its trainer."""
        self.shape_reward: Callable[..., list[Any]] = partial(hooks.hook.shape_reward, run=None)
        """The hook, called with ``step``; the trainer replaces it by one that passes the run."""
        self.stats = EpisodeStats(self.num_envs, game.layout.causes, self.device)
        self.buffer = RolloutBuffer(config.ppo.num_steps)
        self.normalizers = {
            name: ReturnNormalizer(self.num_envs, config.ppo.gamma).to(self.device) for name in _NORMALIZED
        }
        self.privileged: ObservationNormalizer | None = None
        """Normaliser of the victim's observation, for critics that read it."""
        if learning and config.ppo.critic_observes == "both":
            width, clip = game.layout.sides[1 - adversary_side].observation_size, config.ppo.observation_clip
            self.privileged = ObservationNormalizer(width, clip).to(self.device)
        self.contexts = {
            "adversary": self._context("adversary", adversary_side, generators["method"]),
            "victim": self._context("victim", 1 - adversary_side, generators["victim"]),
        }
        seen = ObservationFilter(hooks, {c.side: c for c in self.contexts.values()})
        self._games = TwoPlayerGames(game, self.device, seen)
        self._shapes = learning and hooks.implements("shape_reward")
        self.relabels = False
        """Stored rewards are not normalised until :meth:`relabel`, which the trainer who sets this calls."""
        self.keeps_victim_states = False
        self.victim_states: tuple[Any, Any] = (None, None)
        """Recurrent states in which the victim began the last whole rollout and the next one, if kept."""
        sides = {"successors": adversary_side, "victim_successors": 1 - adversary_side}
        self._followed = {name: side for name, side in sides.items() if learning and hooks.asks_for(name)}
        self._pending: Pending | None = None

    def _context(self, role: Any, side: int, generator: torch.Generator) -> Context:
        seat = self.game.layout.sides[side]
        return Context(side=side, role=role, seat=seat, mode="train", device=self.device, generator=generator)

    @property
    def pending(self) -> Pending:
        """The current observation; games start with the first call."""
        if self._pending is None:
            self._games.reset()
            self._observe()
        assert self._pending is not None
        return self._pending

    def get_observations(self) -> TensorDict:
        """Normalised observation groups of the adversary, batch (num_envs,)."""
        return self.pending.observations

    @torch.inference_mode()
    def step(self, actions: Tensor) -> tuple[TensorDict, Tensor, Tensor, dict[str, Any]]:
        """Play one step of every game; ended games are reset.

        Args:
            actions: of the adversary, shape (num_envs, num_actions).

        Returns:
            next observations, shaped and normalised rewards (num_envs,), end flags (num_envs,) bool,
            and an empty dict: time-outs are outcomes here and never bootstrapped.
        """
        pending = self.pending
        victim = pending.victim
        if victim is None:
            view = pending.view
            victim = self._victim_acts(View(view.opponent, view.own, view.first, actions))
        result = self._games.step({self.side: actions, 1 - self.side: victim.action})
        step = self._step_batch(pending, victim, actions, result)
        shaped = self._shape(step)
        self.buffer.add(step, shaped, pending.groups)
        self.steps += self.num_envs
        last = {name: self.game.observations[side][result.done] for name, side in self._followed.items()}
        self._games.reset(result.done)
        self.episode_length_buf = torch.where(step.done, 0, self.episode_length_buf + 1)
        self._observe()
        for name, side in self._followed.items():
            self.buffer.follow(name, self._games.observation(side), step.done, self._tensor(last[name]))
        return self.pending.observations, shaped, step.done, {}

    def finish_rollout(self) -> Rollout:
        """All steps since the last call."""
        pending = self.pending
        return self.buffer.finish(pending.view.own, pending.view.opponent, pending.groups)

    def relabel(self, rollout: Rollout, reward: Tensor) -> None:
        """Make ``reward`` (T, n), not normalised, the rollout's ``shaped_reward``, from which PPO learns.

        Normalised step by step, as :meth:`step` does where nothing is relabelled.
        """
        normalizer = self.normalizers["shaped"]
        for shaped, value, done in zip(rollout.shaped_reward, reward, rollout.done, strict=True):
            shaped.copy_(normalizer.update(value, done) if self.config.reward.normalize else value)

    @torch.inference_mode()
    def _observe(self) -> None:
        games = self._games
        own, opponent = games.observation(self.side), games.observation(1 - self.side)
        if self.keeps_victim_states and self.buffer.at_start:
            self.victim_states = self.victim_states[1], copy.deepcopy(self.victim.recurrent_state())
        victim = None if self.victim_answers else self._victim_acts(games.view(1 - self.side))
        view = View(own, opponent, games.first, None if victim is None else victim.action)
        groups = self.builder.groups(self.contexts["adversary"], view)
        observations = self.builder.normalize(groups, update=self.learning)
        if self.privileged is not None:
            self.privileged.update(opponent)
            left = 1 - 2 * self.episode_length_buf / self.max_episode_length
            seen = torch.cat((self.privileged(opponent), left.unsqueeze(-1)), dim=-1)
            observations[PRIVILEGED_GROUP] = seen
        self._pending = Pending(view, victim, groups, observations)

    def _victim_acts(self, view: View) -> Decision:
        sample = self.config.victim_actions == "sample"
        return self.victim.act(view, sample=sample, generator=self.generators["victim"])

    def _step_batch(self, pending: Pending, victim: Decision, actions: Tensor, result: GameStep) -> StepBatch:
        seats = [self.side, 1 - self.side]
        c = dense_share(self.config, self.weights, self.played())
        reward, victim_reward = self._tensor(training_reward(result, self.weights, c)[seats]).float()
        done = self._tensor(result.done)
        winner = self._tensor(result.winner)
        outcome = torch.where(winner < 0, 0, torch.where(winner == self.side, 1, -1)).to(torch.int8)
        normalized = {}
        for name, value in (("adversary", reward), ("victim", victim_reward)):
            normalizer = self.normalizers[name]
            normalized[name] = normalizer.update(value, done) if self.learning else normalizer(value)
        return StepBatch(
            observation=pending.view.own,
            victim_observation=pending.view.opponent,
            action=actions,
            victim_action=victim.action,
            victim_distribution=victim.distribution,
            reward=reward,
            victim_reward=victim_reward,
            normalized_reward=normalized["adversary"],
            normalized_victim_reward=normalized["victim"],
            sparse=self._tensor(result.sparse[seats]),
            dense=self._tensor(result.dense[seats]),
            first=pending.view.first,
            done=done,
            outcome=outcome,
            cause=self._tensor(result.cause),
        )

    def _shape(self, step: StepBatch) -> Tensor:
        terms: dict[str, Tensor] = {}
        if self._shapes:
            terms = self.hooks.merged(self.shape_reward(step=step), "shape_reward")
        total = step.reward
        for name, value in terms.items():
            total = total + self.hooks.checked("shape_reward", name, value, tuple(total.shape))
        if not all_finite(total):
            raise PluginError(f"game {self.config.env!r} gives NaN or infinite rewards")
        taken = terms.keys() & _OWN_TERMS
        if taken:
            raise self.hooks.plugin_error("shape_reward", f"the name {min(taken)!r} is taken; choose another")
        self.stats.add(step, {"adversary": step.reward, "victim": step.victim_reward, **terms})
        if self.relabels or not self.config.reward.normalize:
            return total
        normalizer = self.normalizers["shaped"]
        return normalizer.update(total, step.done) if self.learning else normalizer(total)

    def _tensor(self, array: Any) -> Tensor:
        return torch.from_numpy(array).to(self.device)

    def state_dict(self) -> dict[str, Any]:
        """Everything between two steps: physics, rules, pending decisions, statistics."""
        pending = self.pending
        victim = pending.victim
        distribution = None if victim is None else victim.distribution
        return {
            "game": self.game.state_dict(),
            "victim": self.victim.recurrent_state(),
            "steps": self.steps,
            "lengths": self.episode_length_buf.clone(),
            "stats": self.stats.state_dict(),
            "normalizers": {name: module.state_dict() for name, module in self.normalizers.items()},
            "privileged": None if self.privileged is None else self.privileged.state_dict(),
            "pending": {
                "own": pending.view.own.clone(),
                "opponent": pending.view.opponent.clone(),
                "first": pending.view.first,
                "action": None if victim is None else victim.action,
                "mean": None if distribution is None else distribution.mean,
                "std": None if distribution is None else distribution.std,
                "groups": {name: value.clone() for name, value in pending.groups.items()},
                "observations": dict(pending.observations.items()),
                **({"victim_state": self.victim_states[1]} if self.keeps_victim_states else {}),
            },
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on exactly where :meth:`state_dict` was taken."""
        self.game.load_state_dict(state["game"])
        self.victim.load_recurrent_state(_to_device(state["victim"], self.device))
        self.steps = state["steps"]
        self.episode_length_buf = state["lengths"].to(self.device)
        self.stats.load_state_dict(state["stats"])
        for name, module in self.normalizers.items():
            module.load_state_dict(state["normalizers"][name])
        if self.privileged is not None:
            self.privileged.load_state_dict(state["privileged"])
        saved = _to_device(state["pending"], self.device)
        self.victim_states = None, saved.get("victim_state")
        distribution = None if saved["mean"] is None else DiagonalGaussian(saved["mean"], saved["std"])
        self._pending = Pending(
            view=View(saved["own"], saved["opponent"], saved["first"], saved["action"]),
            victim=None if saved["action"] is None else Decision(saved["action"], distribution),
            groups=saved["groups"],
            observations=TensorDict(saved["observations"], batch_size=[self.num_envs], device=self.device),
        )

    def restart(self) -> None:
        """Restart all games at the next observation, after a change of networks."""
        self._pending = None


def _to_device(value: Any, device: torch.device) -> Any:
    if isinstance(value, Tensor):
        return value.to(device)
    if isinstance(value, Mapping):
        return {key: _to_device(item, device) for key, item in value.items()}
    return value
