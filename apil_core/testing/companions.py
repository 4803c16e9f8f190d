"""Companions of the method under test: a method that requires it, and an observer."""

from __future__ import annotations

import sys

import torch
from torch import Tensor

from apil_core.api.hooks import hookimpl
from apil_core.api.method import Method, Run
from apil_core.api.specs import MethodSpec
from apil_core.api.types import Context, Rollout, StepBatch, View
from apil_core.plugins.discovery import PluginRecord, PluginRegistry

FOLLOWER, OBSERVER = "apil_testing_follower", "apil_testing_observer"
TERM, GROUP, STREAM, METRIC = "follower_term", "follower_group", "follower_stream", "follower_metric"


class Follower(Method):
    """Implements every hook that several plugins may implement, under its own names.

    Attributes:
        seen_groups: names of the groups in the last rollout.
        seen_streams: names of the streams it was shown, or ``None`` if another combined the advantages.
    """

    seen_groups: frozenset[str] = frozenset()

    @hookimpl
    def extend_observation(self, context: Context, view: View) -> dict[str, Tensor]:
        """Return one column, (n, 1)."""
        return {GROUP: view.first.float().unsqueeze(-1)}

    @hookimpl
    def shape_reward(self, run: Run, step: StepBatch) -> dict[str, Tensor]:
        """Return a small constant, (n,)."""
        return {TERM: torch.full_like(step.reward, 0.01)}

    @hookimpl
    def relabel_reward(self, rollout: Rollout, reward: Tensor, successors: Tensor) -> Tensor:
        """Return a reward that depends on the observations after each step, (T, n)."""
        return reward + 0.01 * (successors - rollout.observation).square().mean(-1)

    @hookimpl
    def finish_rollout(self, run: Run, rollout: Rollout) -> dict[str, Tensor]:
        """Return a stream, (T, n)."""
        return {STREAM: rollout.normalized_reward.clone()}

    @hookimpl
    def update_auxiliary(self, run: Run, rollout: Rollout) -> dict[str, float]:
        """Store the names of the rollout's groups; return a metric."""
        self.seen_groups = frozenset(rollout.groups)
        return {METRIC: 1.0}


@hookimpl
def filter_observation(context: Context, side: int, obs: Tensor) -> Tensor:
    """Add noise of standard deviation 0.01 to both sides' observations, (n, o)."""
    return obs + 0.01 * torch.randn(
        obs.shape, generator=context.generator, device=obs.device, dtype=obs.dtype
    )


def beside(registry: PluginRegistry, method: MethodSpec) -> None:
    """Add both to a registry; the follower requires ``method``."""
    module = sys.modules[__name__]
    follower = MethodSpec(FOLLOWER, f"{__name__}:Follower", requires=(method.name,))
    registry.methods[FOLLOWER] = follower
    registry.modules[OBSERVER] = module
    record = PluginRecord(OBSERVER, "", f"module {__name__}", hooks=("filter_observation",))
    registry.records.append(record)
