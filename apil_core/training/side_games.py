"""A second set of games for methods that need separate rollouts (``run.collect``)."""

from __future__ import annotations

from typing import Any

import torch

from apil_core.api.policy import Policy
from apil_core.api.types import Rollout
from apil_core.plugins.discovery import PluginRegistry
from apil_core.training.attack_env import AttackEnv
from apil_core.training.build import RunParts, seeded_games
from apil_core.training.rollout_buffer import RolloutBuffer


class SideGames:
    """Plays the current adversary against any policy in the victim's seat. Built on first use.

    Args:
        attack: the run whose adversary plays.
        plugins: to build the games from.
    """

    def __init__(self, attack: RunParts, plugins: PluginRegistry):
        self._attack = attack
        self._plugins = plugins
        self._env: AttackEnv | None = None
        self._saved: dict[str, Any] | None = None

    @property
    def steps(self) -> int:
        """Environment steps played here."""
        if self._env is not None:
            return self._env.steps
        return int(self._saved["steps"]) if self._saved is not None else 0

    def collect(self, policy: Policy, steps: int) -> Rollout:
        """Play ``steps`` vectorised steps; games continue from the last call."""
        if self._env is None:
            self._env = self._build(policy)
        with torch.inference_mode():
            return self._play(self._env, policy, steps)

    def _play(self, env: AttackEnv, policy: Policy, steps: int) -> Rollout:
        env.played = self._attack.env.played
        env.victim = policy
        env.buffer = RolloutBuffer(steps)  # earlier rollouts may still be in use
        # reward statistics are the training games': r̂ must mean the same in both
        for name, module in env.normalizers.items():
            module.moments.load_state_dict(self._attack.env.normalizers[name].moments.state_dict())
        observations = env.get_observations()
        for _ in range(steps):
            actions = self._attack.learner.actor(observations).sample(self._attack.generators["method"])
            observations, _, _, _ = env.step(actions)
        env.stats.metrics()  # not used here: drop, or they accumulate
        return env.finish_rollout()

    def _build(self, policy: Policy) -> AttackEnv:
        attack, config = self._attack, self._attack.config
        env = AttackEnv(
            seeded_games(config, self._plugins, attack.world, "side games"),
            policy,
            attack.builder,
            attack.hooks,
            config,
            weights=attack.env.weights,
            adversary_side=attack.adversary_side,
            generators=dict.fromkeys(("victim", "method"), attack.generators["method"]),
            learning=False,
        )
        if self._saved is not None:
            env.load_state_dict(self._saved)
            self._saved = None
        return env

    def close(self) -> None:
        """Release the games' resources, if there are any."""
        if self._env is not None:
            self._env.game.close()

    def state_dict(self) -> dict[str, Any] | None:
        """The side games' state, or ``None`` if there never were any."""
        return self._env.state_dict() if self._env is not None else self._saved

    def load_state_dict(self, state: dict[str, Any] | None) -> None:
        """Restore; the games themselves are built when they are next needed."""
        self._saved = state
