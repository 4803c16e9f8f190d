"""The games of a retraining: the learning victim in one seat, the mixture of opponents in the other."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from apil_core.api.game import Game, GameStep
from apil_core.api.specs import RewardWeights
from apil_core.api.types import View
from apil_core.common.errors import PluginError
from apil_core.common.tensors import all_finite
from apil_core.runs.retraining.config import RetrainConfig
from apil_core.runs.retraining.learner import VictimLearner
from apil_core.runs.retraining.mixture import MixturePolicy
from apil_core.runs.retraining.tally import MIXED, OpponentTally
from apil_core.training.normalize import ReturnNormalizer
from apil_core.training.rewards import training_reward


class RetrainingGames:
    """Stepped together, the victim acting first, so that an oracle among its opponents sees its action.

    Attributes:
        largest_reward: there was so far, before normalisation.

    Args:
        config: the retraining's.
        game: seeded; stepped here and nowhere else.
        opponents: in the other seat.
        weights: of the training reward, of which the outcome's counts.
        generator: of the opponents' actions.
        device: of the networks.
    """

    def __init__(
        self,
        config: RetrainConfig,
        game: Game,
        opponents: MixturePolicy,
        weights: RewardWeights,
        generator: torch.Generator,
        device: torch.device,
    ):
        self.config = config
        self.game = game
        self.opponents = opponents
        self.weights = weights
        self.generator = generator
        self.device = device
        self.side = config.victim_side
        self.normalizer = ReturnNormalizer(game.num_envs, config.ppo.gamma).to(device)
        per_step = config.mix == "per_step" and len(opponents.policies) > 1
        labels = (MIXED,) if per_step else config.labels
        self.tally = OpponentTally(labels, game.layout.causes, game.num_envs)
        self._one_label = per_step
        self.largest_reward = 0.0
        self._first: Tensor | None = None

    @property
    def first(self) -> Tensor:
        """(n,) bool, a game starts with the present observation; games start with the first call."""
        if self._first is None:
            self.game.reset()
            self._first = torch.ones(self.game.num_envs, dtype=torch.bool, device=self.device)
        return self._first

    def observation(self, side: int) -> Tensor:
        """What that side sees now, (n, o)."""
        return torch.from_numpy(self.game.observations[side]).to(self.device)

    @property
    def reward_scale(self) -> float:
        """What a reward of 1 comes to for the learner, as far as can be told by now."""
        if not self.config.normalize_reward:
            return 1.0
        return float(self.normalizer(torch.tensor([self.largest_reward]))) / self.largest_reward

    @torch.no_grad()  # not inference mode: the update differentiates through what is kept here
    def play(self, learner: VictimLearner, steps: int) -> None:
        """Play ``steps`` steps of every game and let the learner record them; ended games start anew."""
        for _ in range(steps):
            first, side = self.first, self.side
            own, other = self.observation(side), self.observation(1 - side)
            action = learner.act(own)
            view = View(other, own, first, action)
            sample = self.config.adversary_actions == "sample"
            answer = self.opponents.act(view, sample=sample, generator=self.generator).action
            chosen = {side: action.cpu().numpy(), 1 - side: answer.cpu().numpy()}
            result = self.game.step((chosen[0], chosen[1]))
            learner.record(*self._outcome(result))

    def _outcome(self, result: GameStep) -> tuple[Tensor, Tensor]:
        """Normalised rewards and end flags, (n,) each; starts new games where old ones ended."""
        reward = torch.from_numpy(training_reward(result, self.weights, 0.0)[self.side]).float()
        if not all_finite(reward):
            raise PluginError(f"game {self.config.env!r} gives NaN or infinite rewards")
        self.largest_reward = max(self.largest_reward, float(reward.abs().max()))
        reward = reward.to(self.device)
        done = torch.from_numpy(np.array(result.done)).to(self.device)
        self.tally.add(torch.from_numpy((result.sparse + result.dense)[self.side]), done)
        if self.config.normalize_reward:
            reward = self.normalizer.update(reward, done)
        if result.done.any():
            self._count(result)
            self.game.reset(np.array(result.done))
        self._first = done
        return reward, done

    def _count(self, result: GameStep) -> None:
        ended = np.flatnonzero(result.done)
        winner = result.winner[ended]
        outcomes = np.where(winner < 0, 0, np.where(winner == self.side, 1, -1))
        turn = self.opponents.turn.cpu().numpy()[ended]
        against = np.zeros_like(turn) if self._one_label else turn
        self.tally.ended(
            against.tolist(), outcomes.tolist(), result.cause[ended].tolist(), result.lengths[ended].tolist()
        )

    def state_dict(self) -> dict[str, Any]:
        """Everything between two steps."""
        first = self.first
        return {
            "game": self.game.state_dict(),
            "first": first.clone(),
            "opponents": self.opponents.recurrent_state(),
            "normalizer": self.normalizer.state_dict(),
            "tally": self.tally.state_dict(),
            "generator": self.generator.get_state(),
            "largest_reward": self.largest_reward,
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on exactly where :meth:`state_dict` was taken."""
        self.game.load_state_dict(state["game"])
        self._first = state["first"].to(self.device)
        self.opponents.load_recurrent_state(state["opponents"])
        self.normalizer.load_state_dict(state["normalizer"])
        self.tally.load_state_dict(state["tally"])
        self.generator.set_state(state["generator"].cpu())
        self.largest_reward = state["largest_reward"]
