"""A Gymnasium ``VectorEnv`` as a ``VecEnv`` of Stable-Baselines3 (the extra ``sb3``)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NoReturn

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvStepReturn

from apil_core.api.game import Array
from apil_core.common.errors import ConfigError


class BatchVecEnv(VecEnv):
    """Steps all games at once; the infos of games that go on are empty.

    An ended game's info has what ``final_info`` has, ``terminal_observation``, ``TimeLimit.truncated``,
    and ``is_success`` (won), from which Stable-Baselines3 logs ``rollout/success_rate``.
    """

    def __init__(self, env: VectorEnv[Array, Array, Array]):
        if env.metadata.get("autoreset_mode") is not AutoresetMode.SAME_STEP:
            raise ConfigError(f"{env}: Stable-Baselines3 needs AutoresetMode.SAME_STEP")
        self.env = env
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)

    def reset(self) -> Array:
        """Start all games; the seed given to ``seed`` before counts once, for all of them together."""
        observations, _ = self.env.reset(seed=self._seeds[0])
        self._reset_seeds()
        return observations

    def step_async(self, actions: Array) -> None:
        """Keep the actions for :meth:`step_wait`."""
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """One control step of all games; those that end start anew."""
        observations, rewards, over, cut, infos = self.env.step(self._actions)
        dones = over | cut
        rows: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        final = {key: column for key, column in infos.get("final_info", {}).items() if key[0] != "_"}
        for i in np.flatnonzero(dones):
            rows[i] = {key: column[i] for key, column in final.items()}
            rows[i]["is_success"] = final["winner"][i]
            rows[i]["terminal_observation"] = infos["final_obs"][i]
            rows[i]["TimeLimit.truncated"] = bool(cut[i] and not over[i])
        return observations, rewards, dones, rows

    def close(self) -> None:
        """Release the games' threads."""
        self.env.close()

    def get_images(self) -> Sequence[Array | None]:
        """A picture of each game."""
        pictures: Any = self.env.render()
        return pictures or [None] * self.num_envs

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """The batch's attribute, once for each game."""
        return [getattr(self.env, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> NoReturn:
        """Not there: the games are one batch."""
        raise NotImplementedError(f"{attr_name}: the games are one batch and have no attributes of their own")

    def env_method(
        self, method_name: str, *method_args: Any, indices: VecEnvIndices = None, **method_kwargs: Any
    ) -> NoReturn:
        """Not there: the games are one batch."""
        raise NotImplementedError(f"{method_name}: the games are one batch and have no methods of their own")

    def env_is_wrapped(
        self, wrapper_class: type[gymnasium.Wrapper[Any, Any, Any, Any]], indices: VecEnvIndices = None
    ) -> list[bool]:
        """False for each game: a wrapper of single environments cannot be around a batch."""
        return [False for _ in self._get_indices(indices)]
