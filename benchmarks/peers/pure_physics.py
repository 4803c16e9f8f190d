"""The work all frameworks share: the game's physics, alone."""

from __future__ import annotations

import torch
from task import Task

WARM_UP = 96
"""Control steps before those that are timed: by then some robots have fallen and some games have ended."""

RECORDED = 32
"""Control steps that are timed, repeatedly."""


class PurePhysics:
    """The physics calls of a stretch of play (default victim, untrained adversary), repeated on all threads.

    Raises:
        LookupError: nothing in this game can be timed apart.
    """

    name = "pure physics"
    torch_threads = 1

    def __init__(self, task: Task):
        self._game = (attack := task.attack("adrl")).game
        stopwatch = self._game.physics_stopwatch()
        if stopwatch is None:
            self._game.close()
            raise LookupError(f"{task.env} has no physics that can be timed apart")
        self._stopwatch = stopwatch
        env, generator = attack.env, torch.Generator().manual_seed(task.seed)
        for i in range(WARM_UP + RECORDED):
            if i == WARM_UP:
                stopwatch.record()
            env.step(torch.randn(env.num_envs, env.num_actions, generator=generator))
        stopwatch.stop()
        self._steps = RECORDED * env.num_envs

    def warm_up(self) -> None:
        self._stopwatch.replay()

    def timed(self) -> tuple[int, float]:
        """Number of environment steps of the calls, and their seconds."""
        return self._steps, self._stopwatch.replay()

    def close(self) -> None:
        self._stopwatch.close()
        self._game.close()
