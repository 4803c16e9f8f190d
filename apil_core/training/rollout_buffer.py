"""One iteration's transitions in memory: hooks read them as a :class:`Rollout`, PPO through its storage."""

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
    """Columns of T steps, written in place; the same memory serves every iteration.

    Args:
        num_steps: rollout length T.
    """

    def __init__(self, num_steps: int):
        self.num_steps = num_steps
        self._data: dict[str, Tensor] = {}
        self._groups: dict[str, Tensor] = {}
        self._length = 0

    @property
    def at_start(self) -> bool:
        """True if the next step is the first of a rollout."""
        return self._length in (0, self.num_steps)

    def add(self, step: StepBatch, shaped: Tensor, groups: Mapping[str, Tensor]) -> None:
        """Append one vectorised step with its shaped reward (n,) and raw observation groups."""
        if self._length == self.num_steps:
            self._length = 0  # a third-party runner never takes rollouts: keep only the newest
        t = self._length
        rows = {name: getattr(step, name) for name in _FIELDS} | {"shaped_reward": shaped}
        if step.victim_distribution is not None:
            mean, std = step.victim_distribution.mean, step.victim_distribution.std
            rows |= {"victim_mean": mean, "victim_std": std.expand_as(mean)}
        for name, value in rows.items():
            self.column(name, value)[t].copy_(value)
        for name, value in groups.items():
            if name != OWN_GROUP:  # that is ``observation``
                self._column(self._groups, name, value)[t].copy_(value)
        self._length += 1

    def follow(self, name: str, observation: Tensor, done: Tensor, last: Tensor) -> None:
        """Set the newest step's successors of that name.

        Args:
            name: of the rollout's field.
            observation: after the step and the resets, (n, o).
            done: (n,) bool, games that ended with the step.
            last: of those, their last observations, (m, o).
        """
        row = self.column(name, observation)[self._length - 1]
        row.copy_(observation)
        row[done] = last

    def column(self, name: str, row: Tensor) -> Tensor:
        """All steps of one of a rollout's fields, (T, n, ...), made for rows like that one if it is new."""
        return self._column(self._data, name, row)

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
            next_observation=trainable(next_observation),
            next_victim_observation=trainable(next_victim_observation),
            groups={name: values[:length] for name, values in self._groups.items()},
            next_groups={name: trainable(v) for name, v in next_groups.items() if name != OWN_GROUP},
        )

    def _column(self, store: dict[str, Tensor], name: str, row: Tensor) -> Tensor:
        if name not in store:
            # not an inference tensor, in any mode of the caller: hooks train on these
            with torch.inference_mode(False):
                store[name] = torch.zeros((self.num_steps, *row.shape), dtype=row.dtype, device=row.device)
        return store[name]


def trainable(value: Tensor) -> Tensor:
    """A copy that autograd accepts: collection runs in inference mode, whose tensors it refuses."""
    with torch.inference_mode(False):
        return torch.empty(value.shape, dtype=value.dtype, device=value.device).copy_(value)
