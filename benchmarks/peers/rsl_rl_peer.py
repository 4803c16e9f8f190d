"""rsl_rl's own runner on our batched games, which follow its ``VecEnv``."""

from __future__ import annotations

import contextlib
import io
from typing import Any

from rsl_rl.runners import OnPolicyRunner
from task import Task

from apil_core.api.config import PPOConfig


def runner_config(ppo: PPOConfig, groups: list[str]) -> dict[str, Any]:
    """ADRL's settings in rsl_rl's format; Adam's epsilon and the initial weights cannot be set there."""
    network = {"class_name": "MLPModel", "hidden_dims": list(ppo.hidden), "activation": "tanh"}
    spread = {"class_name": "GaussianDistribution", "init_std": ppo.init_std, "std_type": "log"}
    return {
        "num_steps_per_env": ppo.num_steps,
        "save_interval": 10**9,
        "obs_groups": {"actor": groups, "critic": groups},
        "actor": {**network, "distribution_cfg": spread},
        "critic": network,
        "algorithm": {
            "class_name": "PPO",
            "num_learning_epochs": ppo.epochs,
            "num_mini_batches": ppo.minibatches,
            "clip_param": ppo.clip,
            "gamma": ppo.gamma,
            "lam": ppo.lam,
            "value_loss_coef": 0.5 * ppo.value_coefficient,
            "entropy_coef": ppo.entropy_coefficient,
            "learning_rate": ppo.learning_rate,
            "max_grad_norm": ppo.max_grad_norm,
            "use_clipped_value_loss": True,
            "schedule": "fixed",
            "normalize_advantage_per_mini_batch": True,
        },
    }


class RslRl:
    """``OnPolicyRunner.learn``, one iteration at a time, without a log directory.

    Args:
        torch_threads: of the process.
    """

    name = "rsl_rl runner"

    def __init__(self, task: Task, torch_threads: int):
        self.torch_threads = torch_threads
        self._attack = task.attack("adrl")
        env = self._attack.env
        groups = list(map(str, env.get_observations().keys()))
        with contextlib.redirect_stdout(io.StringIO()):  # it prints its networks
            self._runner = OnPolicyRunner(env, runner_config(self._attack.config.ppo, groups))

    def warm_up(self) -> None:
        self.iterate()

    def iterate(self) -> int:
        before = self._attack.env.steps
        self._runner.learn(1)
        self._attack.env.stats.metrics()  # empties its buffers, which would grow without limit
        return self._attack.env.steps - before

    def close(self) -> None:
        self._attack.game.close()
