"""Stable-Baselines3's PPO on our views, the victim inside: an environment per game, or a batch."""

from __future__ import annotations

from functools import partial
from typing import Any

import gymnasium
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv, VecEnv, VecNormalize
from task import Task

from apil_core import ConfigError, GameVectorEnv, OpponentInsideEnv, sb3_vec_env


def make_env(task: Task) -> gymnasium.Env[Any, Any]:
    return OpponentInsideEnv(task.env, task.victim, options=task.options)


def make_env_of_worker(task: Task) -> gymnasium.Env[Any, Any]:
    torch.set_num_threads(1)  # a process per environment: several threads each would oversubscribe the cores
    return make_env(task)


def vec_env(task: Task, text: str) -> VecEnv:
    """Make the games, stepped in turn in this process, each in its own, or as one batch.

    Args:
        text: ``dummy:N``, ``subproc:N`` or ``batch:N``, for N games.

    Raises:
        ConfigError: it is none of them.
    """
    kind, _, count = text.partition(":")
    if kind not in ("dummy", "subproc", "batch") or not count.isdecimal() or int(count) == 0:
        raise ConfigError(f"--sb3 {text!r}: must be dummy:N, subproc:N or batch:N")
    if kind == "batch":
        games = {"num_envs": int(count), "threads": task.threads, "options": task.options}
        return sb3_vec_env(GameVectorEnv(task.env, task.victim, **games))
    if kind == "dummy":
        return DummyVecEnv([partial(make_env, task)] * int(count))
    return SubprocVecEnv([partial(make_env_of_worker, task)] * int(count))


class StableBaselines:
    """Its PPO with ADRL's settings; ``learn`` in chunks of one rollout.

    Args:
        text: see :func:`vec_env`.
        torch_threads: in the process that learns.
    """

    def __init__(self, task: Task, text: str, torch_threads: int):
        self.name = f"sb3 {text}"
        self.torch_threads = torch_threads
        self._batch = task.batch
        ppo = task.config("adrl").ppo
        envs = vec_env(task, text)
        self._envs = VecNormalize(envs, gamma=ppo.gamma, clip_obs=ppo.observation_clip, clip_reward=10.0)
        self._model = PPO(
            "MlpPolicy",  # tanh layers, orthogonal weights, Adam's epsilon 1e-5: as in APIL
            self._envs,
            learning_rate=ppo.learning_rate,
            n_steps=task.steps_each(envs.num_envs),
            batch_size=task.batch // ppo.minibatches,
            n_epochs=ppo.epochs,
            gamma=ppo.gamma,
            gae_lambda=ppo.lam,
            clip_range=ppo.clip,
            clip_range_vf=ppo.clip,
            ent_coef=ppo.entropy_coefficient,
            vf_coef=0.5 * ppo.value_coefficient,  # theirs has no ½ in the loss
            max_grad_norm=ppo.max_grad_norm,
            policy_kwargs={"net_arch": list(ppo.hidden)},
            seed=task.seed,
            stats_window_size=1000,  # games, as ours
            device="cpu",
        )

    def warm_up(self) -> None:
        """Start the workers and play a few steps; a whole rollout would take a minute."""
        self._envs.reset()
        for _ in range(10):
            self._envs.step(self._actions())

    def _actions(self) -> Any:
        return [self._envs.action_space.sample() for _ in range(self._envs.num_envs)]

    def iterate(self) -> int:
        before = self._model.num_timesteps
        self._model.learn(self._batch, reset_num_timesteps=False)
        return int(self._model.num_timesteps - before)

    def close(self) -> None:
        self._envs.close()
