"""Preallocated storage of one iteration's transitions, handed to hooks as a :class:`Rollout`."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor

from apil_core.api.types import OWN_GROUP, Rollout, StepBatch

_FIELDS = (
    "observation",
    "victim_observation",
    "action",
    "victim_action",
    "reward",
    "victim_reward",
    "normalized_reward",
    "normalized_victim_reward",
    "first",
    "done",
)


class RolloutBuffer:
    """Writes steps in place; the same memory serves every iteration.

    Args:
        num_steps: rollout length T.
    """

    def __init__(self, num_steps: int):
        self.num_steps = num_steps
        self._data: dict[str, Tensor] = {}
        self._groups: dict[str, Tensor] = {}
        self._length = 0

    def add(self, step: StepBatch, shaped: Tensor, groups: Mapping[str, Tensor]) -> None:
        """Append one vectorised step with its shaped reward (n,) and raw observation groups."""
        if self._length == self.num_steps:
            self._length = 0  # a foreign runner never asks for rollouts: keep the newest
        t = self._length
        for name in _FIELDS:
            self._put(self._data, name, t, getattr(step, name))
        self._put(self._data, "shaped_reward", t, shaped)
        if step.victim_distribution is not None:
            self._put(self._data, "victim_mean", t, step.victim_distribution.mean)
            std = step.victim_distribution.std
            self._put(self._data, "victim_std", t, std.expand_as(step.victim_distribution.mean))
        for name, value in groups.items():
            if name != OWN_GROUP:  # that is ``observation``
                self._put(self._groups, name, t, value)
        self._length += 1

    def finish(
        self, next_observation: Tensor, next_victim_observation: Tensor, next_groups: Mapping[str, Tensor]
    ) -> Rollout:
        """The rollout of all steps added since the last call, as views of the buffers."""
        length, self._length = self._length, 0
        data = {name: values[:length] for name, values in self._data.items()}
        data.setdefault("victim_mean", None)  # type: ignore[arg-type]
        data.setdefault("victim_std", None)  # type: ignore[arg-type]
        return Rollout(
            **data,
            next_observation=_trainable(next_observation),
            next_victim_observation=_trainable(next_victim_observation),
            groups={name: values[:length] for name, values in self._groups.items()},
            next_groups={name: _trainable(v) for name, v in next_groups.items() if name != OWN_GROUP},
        )

    def _put(self, store: dict[str, Tensor], name: str, t: int, value: Tensor) -> None:
        if name not in store:
            # not an inference tensor, whatever mode the caller is in: hooks train on these
            with torch.inference_mode(False):
                store[name] = torch.zeros(
                    (self.num_steps, *value.shape), dtype=value.dtype, device=value.device
                )
        store[name][t].copy_(value)


def _trainable(value: Tensor) -> Tensor:
    """A copy that autograd accepts: collection runs in inference mode, whose tensors it refuses."""
    with torch.inference_mode(False):
        return torch.empty(value.shape, dtype=value.dtype, device=value.device).copy_(value)
