"""This framework's own training loop."""

from __future__ import annotations

from task import Task

from apil_core.plugins.registry import default_plugins
from apil_core.training.trainer import Trainer


class Ours:
    """Whole iterations of a method as in ``apil run``, without recorders and checkpoints."""

    torch_threads = 1  # as in a run

    def __init__(self, task: Task, method: str):
        self.name = f"apil {method}"
        self._attack = task.attack(method)
        self._trainer = Trainer(self._attack, default_plugins())

    def warm_up(self) -> None:
        self.iterate()

    def iterate(self) -> int:
        before = self._trainer.steps
        self._trainer.iterate()
        return self._trainer.steps - before

    def close(self) -> None:
        self._attack.game.close()
        self._trainer.side_games.close()
