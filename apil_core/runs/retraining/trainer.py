"""The iterations of a retraining: play, estimate, update."""

from __future__ import annotations

import time
from typing import Any

import torch

from apil_core.policies.frozen_policy import StoredCritic
from apil_core.runs.retraining.config import RetrainConfig
from apil_core.runs.retraining.games import RetrainingGames
from apil_core.runs.retraining.learner import VictimLearner

_WARMUP = {"stored": 1, "new": 10}
"""First iterations that train the critic alone: a stored one only has to find its units."""


class RetrainTrainer:
    """A retraining in memory.

    Attributes:
        iteration, steps: done so far.
        wall_seconds: spent in iterations.

    Args:
        config: complete.
        games: the victim plays in.
        learner: of the victim.
        stored: whose network the critic was made from; its units are found with the first rollout.
    """

    def __init__(
        self,
        config: RetrainConfig,
        games: RetrainingGames,
        learner: VictimLearner,
        stored: StoredCritic | None,
    ):
        self.config = config
        self.games = games
        self.learner = learner
        self.stored = stored
        self.iteration = 0
        self._in_units = False
        self.wall_seconds = 0.0

    @property
    def batch(self) -> int:
        """Environment steps of one iteration."""
        return self.config.num_envs * self.config.ppo.num_steps

    @property
    def steps(self) -> int:
        """Environment steps so far."""
        return self.iteration * self.batch

    @property
    def finished(self) -> bool:
        """Whether the budget is used up."""
        return self.steps >= self.config.steps

    def iterate(self) -> dict[str, float]:
        """One iteration; returns its metrics."""
        begin = time.perf_counter()
        self.games.play(self.learner, self.config.ppo.num_steps)
        collected = time.perf_counter()
        metrics = self._learn()
        end = time.perf_counter()
        self.iteration += 1
        self.wall_seconds += end - begin
        return {
            **metrics,
            **self.games.tally.metrics(),
            "iteration": self.iteration,
            "steps": self.steps,
            "total_steps": self.config.steps,
            "wall_seconds": self.wall_seconds,
            "steps_per_second": self.batch / (end - begin),
            "collect_seconds": collected - begin,
            "update_seconds": end - collected,
        }

    def _learn(self) -> dict[str, float]:
        if not self._in_units:
            if not self.games.largest_reward:  # no outcome yet: nothing to learn from, nor its unit to know
                self.learner.forget()
                return {}
            self._denormalise()
        metrics = self.learner.estimate(self.games.observation(self.config.victim_side))
        warm = self.iteration < self._warmup()
        return metrics | self.learner.update(self._learning_rate(), critic_only=warm)

    def _denormalise(self) -> None:
        """Put a stored critic into the learner's units.

        It gives returns in the victim's own training, normalised by that one's mean and deviation. Their
        unit is the game's sparse reward; ours is ``w_sparse`` of it, normalised and clipped.
        """
        self._in_units = True
        if self.stored is not None:
            unit = self.games.weights.sparse_weight * self.games.reward_scale
            self.learner.critic.rescale(self.stored.deviation * unit, self.stored.mean * unit)

    def _warmup(self) -> int:
        if self.config.critic_warmup is not None:
            return self.config.critic_warmup
        return _WARMUP["new" if self.stored is None else "stored"]

    def _learning_rate(self) -> float:
        ppo = self.config.ppo
        if ppo.lr_schedule == "constant":
            return ppo.learning_rate
        return ppo.learning_rate * max(1.0 - self.steps / self.config.steps, 0.0)

    def state_dict(self) -> dict[str, Any]:
        """The whole retraining at an iteration boundary."""
        return {
            "iteration": self.iteration,
            "steps": self.steps,
            "wall_seconds": self.wall_seconds,
            "in_units": self._in_units,
            "games": self.games.state_dict(),
            "learner": self.learner.state_dict(),
            "generators": {name: g.get_state() for name, g in self.learner.generators.items()},
            "torch_rng": torch.get_rng_state(),
            "config": self.config.model_dump(mode="json"),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on exactly where :meth:`state_dict` was taken."""
        self.iteration = state["iteration"]
        self.wall_seconds = state["wall_seconds"]
        self._in_units = state["in_units"]
        self.games.load_state_dict(state["games"])
        self.learner.load_state_dict(state["learner"])
        for name, generator in self.learner.generators.items():
            generator.set_state(state["generators"][name].cpu())
        torch.set_rng_state(state["torch_rng"].cpu())
