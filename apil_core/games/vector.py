"""A batch of games as a Gymnasium ``VectorEnv``: a policy plays one side, the caller the other."""

from __future__ import annotations

import secrets
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from gymnasium.spaces import Discrete
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from apil_core.api.game import Array, Game, GameStep
from apil_core.api.policy import Policy
from apil_core.common.errors import ConfigError
from apil_core.common.extras import need
from apil_core.games.two_players import TwoPlayerGames
from apil_core.games.views import (
    action_space,
    check_render_mode,
    game_of,
    info_columns,
    observation_space,
    picture,
)
from apil_core.plugins.default_victim import default_victim
from apil_core.plugins.registry import default_plugins
from apil_core.policies.loading import load_victim

if TYPE_CHECKING:
    from stable_baselines3.common.vec_env import VecEnv


class GameVectorEnv(VectorEnv[Array, Array, Array]):
    """``num_envs`` games stepped together, as in training (docs/vector-environments.md).

    Observations (num_envs, o) float32 and rewards (num_envs,) float32, sparse + dense, are the game's own and
    not normalised. Every ending is a termination. An ended game starts anew within the same step; its last
    observation is ``infos["final_obs"][i]``, and ``infos["final_info"]`` has ``winner``, ``tie``, ``cause``.

    Args:
        game: a game, or the name of one.
        opponent: the policy inside, or its name; ``None``: the game's default victim (needs a name).
        num_envs: number of games; ``None``: a ready game's, else 1.
        threads: of the physics, for a game given by name; 0: all CPUs. Does not change results.
        side: the caller's side, 0 or 1; ``None``: the adversary's, which is 1 for a ready game.
        sample: draw the opponent's actions; false takes their mode.
        options: of the game, when given by name, e.g. ``{"physics": "fast"}``.
        render_mode: ``"rgb_array"`` lets :meth:`render` return pictures.

    Raises:
        UnknownNameError: there is no game or policy of that name.
        ConfigError: the number of games, the options or the render mode are wrong; no opponent is known, or
            it does not fit.
        VictimError: the opponent's weights are missing.
    """

    metadata = {"autoreset_mode": AutoresetMode.SAME_STEP, "render_modes": ["rgb_array"]}  # noqa: RUF012

    def __init__(
        self,
        game: Game | str,
        opponent: Policy | str | None = None,
        *,
        num_envs: int | None = None,
        threads: int = 0,
        side: int | None = None,
        sample: bool = True,
        options: dict[str, Any] | None = None,
        render_mode: str | None = None,
    ):
        check_render_mode(render_mode)
        self.render_mode = render_mode
        plugins = default_plugins()
        if isinstance(game, str):
            spec = plugins.game(game)
            side = 1 - spec.victim_side if side is None else side
            opponent = opponent or default_victim(spec, plugins) or None
        if opponent is None:
            raise ConfigError("the view needs an opponent: a policy or the name of one")
        if side not in (None, 0, 1):
            raise ConfigError(f"side must be 0 or 1, not {side!r}")
        self.side = 1 if side is None else side
        self.game = game_of(game, options, num_envs, threads)
        if isinstance(opponent, str):
            opponent = load_victim(opponent, self.game, 1 - self.side, "cpu", plugins)
        self.num_envs = self.game.num_envs
        self.metadata = {**self.metadata, "render_fps": round(1 / self.game.seconds_per_step)}
        self._opponent, self._sample = opponent, sample
        self._generator = torch.Generator()
        self._games = TwoPlayerGames(self.game)
        self._seeded = False
        own = self.game.layout.sides[self.side]
        self.single_observation_space = observation_space(own)
        self.single_action_space = action_space(own)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Start all games; without a seed the random generators continue (initially seeded from entropy).

        Args:
            seed: of all games together and of the opponent's draws.
            options: none are known.
        """
        if options:
            raise ConfigError(f"reset has no options, got {', '.join(map(str, options))}")
        super().reset(seed=seed)
        if seed is not None or not self._seeded:
            start = secrets.randbits(32) if seed is None else seed
            self.game.seed(start)
            self._generator.manual_seed(start)
            self._opponent.seed(start)
            self._seeded = True
        self._games.reset()
        return self._observations(), {}

    def step(self, actions: Array) -> tuple[Array, Array, Array, Array, dict[str, Any]]:
        """One control step of all games; those that end start anew.

        Args:
            actions: (num_envs, a), clipped to their bounds; for a side that chooses, (num_envs,) integers.
        """
        step = self._advance(actions)
        rewards = step.sparse[self.side] + step.dense[self.side]
        done = step.done.copy()
        infos = _masked(info_columns(self.game, step, self.side, ended=False), ~done)
        if done.any():
            last = self._observations()
            infos["final_obs"] = np.full(self.num_envs, None, object)
            for i in np.flatnonzero(done):
                infos["final_obs"][i] = last[i]
            infos["final_info"] = _masked(info_columns(self.game, step, self.side, ended=True), done)
            infos["_final_obs"] = infos["_final_info"] = done
            self._games.reset(done)
        return self._observations(), rewards, done, np.zeros_like(done), infos

    def _advance(self, actions: Array) -> GameStep:
        """As :meth:`step`, but ended games stay as they are."""
        space, shape = self.single_action_space, (self.num_envs, *(self.single_action_space.shape or ()))
        if np.shape(actions) != shape:
            raise ConfigError(f"actions must have the shape {shape}, got {np.shape(actions)}")
        if isinstance(space, Discrete):  # scores, of which the game takes the largest
            actions = np.eye(int(space.n))[np.asarray(actions)]
        other = 1 - self.side
        with torch.no_grad():
            decision = self._opponent.act(
                self._games.view(other), sample=self._sample, generator=self._generator
            )
        own = torch.from_numpy(np.array(actions, np.float32))
        return self._games.step({self.side: own, other: decision.action})

    def render(self) -> tuple[Array, ...] | None:
        """Picture of each game, (360, 640, 3) uint8, opponent blue, caller red; see ``render_mode``."""
        if self.render_mode is None:
            return None
        return tuple(picture(self.game, self.side, i) for i in range(self.num_envs))

    def close_extras(self) -> None:
        """Release the game's threads and processes; a physics' threads end with the last reference to it."""
        self.game.close()
        del self.game, self._games

    def _observations(self) -> Array:
        return self.game.observations[self.side].copy()


def _masked(columns: dict[str, Array], mask: Array) -> dict[str, Any]:
    """Gymnasium's form: a column per key, empty elsewhere, and as ``_key`` where it holds."""
    masked: dict[str, Any] = {}
    for key, column in columns.items() if mask.any() else ():
        masked[key] = np.full(len(mask), None if column.dtype == object else 0, column.dtype)
        masked[key][mask] = column[mask]
        masked[f"_{key}"] = mask
    return masked


def sb3_vec_env(env: VectorEnv[Array, Array, Array]) -> VecEnv:
    """The same games as a ``VecEnv`` of Stable-Baselines3 (docs/vector-environments.md).

    Args:
        env: a :class:`GameVectorEnv`, or wrappers around one.

    Raises:
        ApilError: stable-baselines3 is not installed.
        ConfigError: ``env`` does not restart ended games within the step.
    """
    need("stable_baselines3")
    from apil_core.games.sb3 import BatchVecEnv

    return BatchVecEnv(env)
