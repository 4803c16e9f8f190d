"""APL's hooks: the reward difference, or the difference of advantages."""

from __future__ import annotations

from torch import Tensor

from apil_apl.config import AplConfig
from apil_core import Method, Rollout, Run, StepBatch, hookimpl, normalize_advantages

STREAM = "victim"
"""Name of the reward stream r^ν when ``advantage_difference`` is on."""


class Apl(Method):
    """∇(V_α − V_ν) is a policy gradient on Δr = r^α − r^ν (Guo et al. 2021; docs/methods.md §1)."""

    options: AplConfig

    @hookimpl
    def shape_reward(self, run: Run, step: StepBatch) -> dict[str, Tensor] | None:
        """The term −r^ν, shape (n,)."""
        if self.options.advantage_difference:
            return None
        return {"minus_victim": -step.victim_reward}

    @hookimpl
    def finish_rollout(self, run: Run, rollout: Rollout) -> dict[str, Tensor] | None:
        """The victim's reward as a stream with its own critic, (T, n), in units of its return's std."""
        if not self.options.advantage_difference:
            return None
        return {STREAM: rollout.normalized_victim_reward}

    @hookimpl
    def combine_advantages(self, run: Run, rollout: Rollout, streams: dict[str, Tensor]) -> Tensor | None:
        """Â_α − Â_ν, each normalised over the rollout, (T, n); PPO clips one ratio around it."""
        if not self.options.advantage_difference:
            return None
        return normalize_advantages(streams["reward"]) - normalize_advantages(streams[STREAM])
