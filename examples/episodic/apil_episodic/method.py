"""The method: each step is paid what it changed in the return that similar past games had."""

from __future__ import annotations

import math
from typing import Any

import torch
from torch import Tensor

from apil_core import Method, MethodSetup, ObservationNormalizer, Rollout, hookimpl
from apil_episodic.config import EpisodicConfig
from apil_episodic.memory import EpisodicMemory


class Episodic(Method):
    """r'_t = r_t + ε (v(z_t) − v(z_{t−1})), v the mean return of the n most similar remembered patterns.

    Attributes:
        games: rows of each game: ``pattern`` z (n, p), its ``value`` v(z), reward ``earned`` and ``age`` in
            steps so far, (n,), and ``pending`` patterns (n, most, p), remembered when it ends.
    """

    options: EpisodicConfig

    def __init__(self, options: EpisodicConfig, setup: MethodSetup):
        super().__init__(options, setup)
        size, p = setup.adversary.observation_size, options.projection
        self.normalizer = ObservationNormalizer(size, clip=5.0).to(setup.device)
        own = torch.Generator().manual_seed(setup.seed)  # other weights are those of any method
        self.matrix = torch.randn(size, p, generator=own).to(setup.device) / math.sqrt(p)
        self.memory = EpisodicMemory(options.capacity, p).to(setup.device)
        self.most = setup.layout.max_steps // options.pattern_length + 1
        self.games: dict[str, Tensor] = {}
        self._metrics: dict[str, float] = {}

    @hookimpl
    def relabel_reward(self, rollout: Rollout, reward: Tensor, successors: Tensor) -> Tensor:
        """Return the revised reward, (T, n); then remember the games that ended."""
        if not self.normalizer.moments.count:  # fixed afterwards: patterns of all rollouts are comparable
            self.normalizer.update(successors.flatten(0, 1))
        features = self.normalizer(successors) @ self.matrix
        n, p = features.shape[1:]
        if not self.games or len(self.games["age"]) != n:  # another number of games: all are new
            pending, zero = reward.new_zeros(n, self.most, p), reward.new_zeros(n)
            self.games = {"pattern": pending[:, 0], "pending": pending, "value": zero, "earned": zero}
            self.games["age"] = zero.long()
        patterns, ended = self._follow(features, reward, rollout)
        values = self.memory.look_up(patterns.flatten(0, 1), self.options.group_size).view_as(reward)
        before = torch.cat([self.games["value"].unsqueeze(0), values[:-1]])
        change = torch.where(rollout.first, 0.0, values - before)
        self.games["value"] = values[-1].clone()
        for found, returns in ended:
            self.memory.write(found, returns)
        self._metrics = {"revision": float(change.abs().mean()), "remembered": float(len(self.memory))}
        return reward + self.options.revision * change

    @hookimpl
    def update_auxiliary(self) -> dict[str, float]:
        """Log the mean size of a change in v, and the number of remembered patterns."""
        return self._metrics

    def _follow(
        self, features: Tensor, reward: Tensor, rollout: Rollout
    ) -> tuple[Tensor, list[tuple[Tensor, Tensor]]]:
        """Patterns z (T, n, p), and of each step with ends the ended games' patterns and returns."""
        k, games, patterns, ended = self.options.pattern_length, self.games, [], []
        pattern, earned, age, pending = (games[name] for name in ("pattern", "earned", "age", "pending"))
        for t, (first, done) in enumerate(zip(rollout.first, rollout.done, strict=True)):
            pattern = torch.where(first.unsqueeze(1), features[t], pattern + (features[t] - pattern) / k)
            earned = torch.where(first, 0.0, earned) + reward[t]
            age = torch.where(first, 0, age) + 1
            patterns.append(pattern)
            kept = (age % k == 0) | done  # the last one, too
            pending[kept, (age[kept] - 1) // k] = pattern[kept]
            if done.any():
                filled = torch.arange(self.most, device=done.device) <= (age[done, None] - 1) // k
                ended.append((pending[done][filled], earned[done].unsqueeze(1).expand_as(filled)[filled]))
        games.update(pattern=pattern, earned=earned, age=age)
        return torch.stack(patterns), ended

    def state_dict(self) -> dict[str, Any]:
        """Return statistics, projection, memory, and what is kept for each game."""
        modules = {"normalizer": self.normalizer.state_dict(), "memory": self.memory.state_dict()}
        return {
            **modules,
            "matrix": self.matrix,
            "games": {name: t.clone() for name, t in self.games.items()},
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore the result of :meth:`state_dict`."""
        self.normalizer.load_state_dict(state["normalizer"])
        self.matrix = state["matrix"].to(self.setup.device)
        self.memory.load_state_dict(state["memory"])
        self.games = {name: t.to(self.setup.device, copy=True) for name, t in state["games"].items()}
