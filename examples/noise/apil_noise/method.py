"""The noise method's hooks."""

from __future__ import annotations

from torch import Tensor

from apil_core import ConfigError, Method, Run, RunConfig, hookimpl


class Noise(Method):
    """Â = 0: the policy gradient is zero, so the policy stays the one it began as."""

    @hookimpl
    def run_started(self, run: Run) -> None:
        """Refuse settings under which something other than the policy gradient would change the policy.

        Raises:
            ConfigError: it would not stay noise.
        """
        reason = what_moves_it(run.config)
        if reason is not None:
            raise ConfigError(f"method noise never learns: {reason}")

    @hookimpl
    def combine_advantages(self, streams: dict[str, Tensor]) -> Tensor:
        """Return zero for every step, (T, n)."""
        return streams["reward"].new_zeros(streams["reward"].shape)


def what_moves_it(config: RunConfig) -> str | None:
    """Describe a setting that would change the policy, with its required value; else ``None``."""
    if config.ppo.entropy_coefficient:
        return f"ppo.entropy_coefficient must be 0, got {config.ppo.entropy_coefficient:g}"
    if config.ppo.optimizer != "adam":
        return f"ppo.optimizer must be adam, got {config.ppo.optimizer} (its weight decay moves the policy)"
    if config.init_from is not None:
        return f"init_from must be empty, got {config.init_from} (the policy would be that run's)"
    return None
