"""The common task: PPO against one victim, with the same settings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

from apil_core import RunConfig
from apil_core.api.config import PPOConfig
from apil_core.common.errors import ConfigError
from apil_core.plugins.default_victim import default_victim
from apil_core.plugins.registry import default_plugins, game_spec
from apil_core.training.build import RunParts, build


@dataclass(frozen=True)
class Task:
    """One game, one victim, one batch.

    Attributes:
        env: name of the game.
        options: of the game.
        victim: name of the policy in the other seat.
        batch: steps of an iteration: collected, then learnt from.
        num_envs: games stepped together in batched frameworks (ours and rsl_rl).
        threads: of the physics; 0: all.
        seed: of everything.
    """

    env: str
    options: dict[str, Any]
    victim: str
    batch: int
    num_envs: int
    threads: int
    seed: int = 0

    def config(self, method: str) -> RunConfig:
        """Configuration of a run of ``method``; PPO's settings are the defaults, for all frameworks."""
        return RunConfig(
            method=method,
            env=self.env,
            victim=self.victim,
            game=self.options,
            num_envs=self.num_envs,
            threads=self.threads,
            seed=self.seed,
            steps=10**9,
            ppo=PPOConfig(num_steps=self.steps_each(self.num_envs)),
        )

    def attack(self, method: str) -> RunParts:
        """Build the parts of the run."""
        return build(self.config(method), default_plugins())

    def steps_each(self, games: int) -> int:
        """Steps per game and iteration, for that number of parallel games.

        Raises:
            ConfigError: the batch is no multiple of them.
        """
        if self.batch % games:
            raise ConfigError(f"a batch of {self.batch} steps cannot be shared by {games} games")
        return self.batch // games


def victim_of(env: str) -> str:
    """Load the game's default victim, by name."""
    plugins = default_plugins()
    return default_victim(game_spec(env, plugins), plugins)


class Contestant(Protocol):
    """A framework that trains one iteration at a time."""

    name: str
    torch_threads: int

    def warm_up(self) -> None:
        """Do the work that is done only once."""

    def iterate(self) -> int:
        """Collect a batch and train on it; return its environment steps."""

    def close(self) -> None:
        """Close games and processes."""
