"""One of several trainings that alternate in a process, each with its own random state."""

from __future__ import annotations

import copy
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import torch

from apil_core.api.config import RunConfig
from apil_core.plugins.discovery import PluginRegistry
from apil_core.plugins.hook_manager import RunHookManager
from apil_core.training.build import build
from apil_core.training.trainer import Trainer

from .hooks import TimedHooks


@dataclass
class Start:
    """State of the games and the victim before a block."""

    game: dict[str, Any]
    victim: dict[str, Any]
    generator: torch.Tensor


class TimedTraining:
    """A whole training; torch's global random generator is set to its own while it runs.

    Args:
        config: of the run.
        plugins: to build it from.
        manager: class of its hook manager; :class:`TimedHooks` where hooks are to be timed.
    """

    def __init__(
        self, config: RunConfig, plugins: PluginRegistry, manager: type[RunHookManager] = TimedHooks
    ):
        self._generator = torch.get_rng_state()
        with self._turn():
            self.attack = build(config, plugins, manager)
            self.trainer = Trainer(self.attack, plugins)
            with self.attack.hooks.attribution():
                self.trainer.hook.run_started(run=self.trainer)

    def iterate(self) -> tuple[float, float]:
        """Run one iteration; return the seconds of its collection, and of all of it."""
        with self._turn():
            begin = time.perf_counter()
            metrics = self.trainer.iterate()
            return metrics["collect_seconds"], time.perf_counter() - begin

    @property
    def timed_hooks(self) -> TimedHooks:
        """Its hook manager, which must be of that class."""
        assert isinstance(self.attack.hooks, TimedHooks)
        return self.attack.hooks

    def start(self) -> Start:
        """State of games and victim, between two iterations."""
        return Start(
            copy.deepcopy(self.attack.game.state_dict()),
            copy.deepcopy(self.attack.victim.recurrent_state()),
            self.attack.generators["victim"].get_state(),
        )

    def close(self) -> None:
        """Release the games."""
        self.trainer.side_games.close()
        self.attack.game.close()

    @contextmanager
    def _turn(self) -> Iterator[None]:
        before = torch.get_rng_state()
        torch.set_rng_state(self._generator)
        try:
            yield
        finally:
            self._generator = torch.get_rng_state()
            torch.set_rng_state(before)
