"""Timing of a MuJoCo game's physics alone: its calls of ``Batch.step``, replayed on another batch."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import mujoco.batch
import numpy as np
from mujoco.batch import Batch

from apil_core import PhysicsStopwatch
from apil_envs.arrays import Array


@dataclass
class Call:
    """One call of ``Batch.step``: start state and arguments.

    Attributes:
        state: of all simulations, (nsim, nstate).
        fields: model fields that differ between simulations, each (nsim, ...).
        arguments, keywords: of the call.
    """

    state: Array
    fields: dict[str, Array]
    arguments: tuple[Any, ...]
    keywords: dict[str, Any]


class BatchStopwatch(PhysicsStopwatch):
    """Records the calls of one batch, and replays them on another.

    Model, threads, arguments (substeps, stage, selection of simulations), start states and the derived
    fields that are copied out are the same.

    Args:
        batch: of the game, complete: all its fields are bound.
    """

    def __init__(self, batch: Batch):
        self._batch = batch
        self._call = batch.step
        self._calls: list[Call] = []
        self._seconds = 0.0
        self.replayed = Batch(batch.model, batch.nsim, batch.nthread, batch.persistent)
        for name in batch._bound:  # mujoco has no public list of them; a test checks this one
            self.replayed.bind(name)
        self._fields = {
            name: self.replayed.expand(name)
            for name in sorted(mujoco.batch.MODEL_FIELDS)
            if batch.expanded(name) is not None
        }

    def record(self) -> None:
        """See :class:`apil_core.PhysicsStopwatch`."""
        self._calls, self._seconds = [], 0.0
        vars(self._batch)["step"] = self._step

    def stop(self) -> float:
        """See :class:`apil_core.PhysicsStopwatch`."""
        vars(self._batch).pop("step", None)
        return self._seconds

    def replay(self) -> float:
        """See :class:`apil_core.PhysicsStopwatch`."""
        seconds = 0.0
        for call in self._calls:
            self.replayed.state[...] = call.state
            for name, values in call.fields.items():
                self._fields[name][...] = values
            begin = time.perf_counter()
            self.replayed.step(*call.arguments, **call.keywords)
            seconds += time.perf_counter() - begin
        return seconds

    def close(self) -> None:
        """See :class:`apil_core.PhysicsStopwatch`."""
        self.stop()
        self._calls = []

    def _step(self, *arguments: Any, **keywords: Any) -> None:
        """Replacement of the batch's step while recording."""
        begin = time.perf_counter()
        fields = {name: self._batch.expand(name).copy() for name in self._fields}
        kept = tuple(_kept(value) for value in arguments)
        keywords = {name: _kept(value) for name, value in keywords.items()}
        self._calls.append(Call(self._batch.state.copy(), fields, kept, keywords))
        self._seconds += time.perf_counter() - begin
        self._call(*arguments, **keywords)


def _kept(argument: Any) -> Any:
    """Copy arrays, as a mask may be overwritten after the call."""
    return argument.copy() if isinstance(argument, np.ndarray) else argument
