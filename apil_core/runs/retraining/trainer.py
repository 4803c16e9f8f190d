"""The run's trainer, for a stored critic: finds its units, and trains it alone for some iterations."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from apil_core.api.policy import PolicyInfo
from apil_core.api.types import Rollout
from apil_core.plugins.discovery import PluginRegistry
from apil_core.policies.frozen_policy import StoredCritic
from apil_core.policies.network import NetworkShape
from apil_core.runs.retraining.config import RetrainConfig
from apil_core.runs.retraining.environment import FixedObservations
from apil_core.training.build import RunParts
from apil_core.training.recurrent_ppo import NetworkLearner
from apil_core.training.trainer import Trainer

_WARMUP = {"stored": 1, "new": 10}
"""Default of ``critic_warmup``; a stored one needs less."""


class RetrainTrainer(Trainer):
    """A retraining in memory.

    Args:
        config: complete.
        attack: its parts; the learner is the victim.
        plugins: as for :class:`Trainer`.
        original: the victim as it was.
        opponents: by label, the baseline last if there is one.
        stored: source of the critic's network; its units are found with the first rollout.
    """

    def __init__(
        self,
        config: RetrainConfig,
        attack: RunParts,
        plugins: PluginRegistry,
        original: PolicyInfo,
        opponents: Mapping[str, PolicyInfo],
        stored: StoredCritic | None,
    ):
        super().__init__(attack, plugins)
        assert isinstance(attack.learner, NetworkLearner)
        self.learner = attack.learner
        self.retraining, self.original, self.opponents = config, original, opponents
        self.stored = stored
        default = _WARMUP["new" if stored is None else "stored"]
        self.warmup = default if config.critic_warmup is None else config.critic_warmup
        self._in_units = False

    def _learn(self, rollout: Rollout, actor_fixed: bool) -> dict[str, float]:
        if not self._in_units:
            largest = float(rollout.reward.abs().max())
            if not largest:  # no outcome yet: nothing to learn from, and the unit is unknown
                self.learner.forget()
                self.warmup += 1
                return {}
            self._denormalise(largest)
        return super()._learn(rollout, actor_fixed or self.iteration < self.warmup)

    def _denormalise(self, largest: float) -> None:
        """Rescale a stored critic to the learner's units, given the largest reward so far.

        It gives returns in the victim's own training, normalised by that one's mean and deviation. Their
        unit is the game's sparse reward; ours is ``w_sparse`` of it, normalised and clipped.
        """
        self._in_units = True
        if self.stored is None:
            return
        env = self.attack.env
        unit = env.weights.sparse_weight
        if self.config.reward.normalize:
            unit *= float(env.normalizers["shaped"](torch.tensor([largest]))) / largest
        self.learner.critic.rescale(self.stored.deviation * unit, self.stored.mean * unit)

    def hardened(self) -> tuple[NetworkShape, dict[str, Tensor]]:
        """The present victim: shape and weights as in a student's file, on the CPU."""
        assert isinstance(self.attack.builder, FixedObservations)
        statistics, policy = self.attack.builder.standardize, self.learner.policy
        found = {
            "observation.mean": statistics.mean,
            "observation.std": statistics.std,
            "log_std": policy.log_std,
            **policy.network.state_dict(),
        }
        weights = {
            name: tensor.detach().cpu().clone() for name, tensor in found.items() if tensor is not None
        }
        return policy.network.shape, weights

    def state_dict(self) -> dict[str, Any]:
        """Return the whole retraining at an iteration boundary."""
        return {**super().state_dict(), "in_units": self._in_units, "warmup": self.warmup}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue exactly where :meth:`state_dict` was taken."""
        super().load_state_dict(state)
        self._in_units = state["in_units"]
        self.warmup = state.get("warmup", self.warmup)  # older checkpoints lack it
