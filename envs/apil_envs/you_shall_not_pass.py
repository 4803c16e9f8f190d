"""You-shall-not-pass: a runner tries to reach a line, a blocker tries to prevent it."""

from __future__ import annotations

import numpy as np

from apil_core import NO_WINNER
from apil_envs import moves
from apil_envs.arrays import Array
from apil_envs.game_base import DIVERGED, GOES_ON, MujocoGame, Verdict
from apil_envs.observe import Block
from apil_envs.options import YouShallNotPassOptions
from apil_envs.senses import duel_blocks, humanoid_blocks

BLOCKER, RUNNER = 0, 1
GOAL_X = -4.0
DOWN = 0.3
PRIZE = 1000.0

CAUSES = ("passed", "runner-down", "time-up", DIVERGED)
PASSED, RUNNER_DOWN, TIME_UP = range(3)


def decide(runner_x: Array, heights: Array, time_up: Array) -> Verdict:
    """The rules, as a pure function of the state.

    Args:
        runner_x: of the runner's mass centre, (n,), m.
        heights: of the roots of blocker and runner, (2, n), m.
        time_up: (n,) bool.
    """
    endings = [runner_x < GOAL_X, heights[RUNNER] <= DOWN, time_up]
    cause = np.select(endings, range(len(endings)), GOES_ON).astype(np.int8)
    passed, down, late = (cause == ending for ending in (PASSED, RUNNER_DOWN, TIME_UP))
    winner = np.select([passed, down | late], [RUNNER, BLOCKER], NO_WINNER).astype(np.int8)
    # a blocker that is down itself, or only waited, wins without a reward
    blocker = PRIZE * (down & (heights[BLOCKER] > DOWN)) - PRIZE * passed
    runner = PRIZE * passed - PRIZE * (down | late)
    return Verdict(cause, winner, np.stack([blocker, runner]))


class YouShallNotPass(MujocoGame):
    """Side 0 is the blocker, side 1 the runner; see docs/games.md for rules and observation order."""

    scene = "you-shall-not-pass"
    side_names = ("blocker", "runner")
    causes = CAUSES
    options_model = YouShallNotPassOptions

    def observation_blocks(self, side: int) -> list[Block]:
        """380 columns."""
        return duel_blocks(self.robots[side], self.robots[1 - side], humanoid_blocks)

    def judge(self) -> Verdict:
        """See :func:`decide`."""
        return decide(self.robots[RUNNER].centre[:, 0], self.heights, self.clock >= self.max_steps)

    def move_rewards(self, moved: Array, verdict: Verdict) -> tuple[Array, Array]:
        """See docs/games.md; shaping rewards the blocker for the runner's distance left, until it passes."""
        blocker, runner = self.robots
        actions = self.raw_actions
        standing = moves.survive(blocker.height >= moves.STANDING)
        costs = moves.control_cost(actions[BLOCKER]) + moves.contact_cost(blocker.contact_force)
        seconds = self.physics.seconds_per_step
        running = moves.run(runner, actions[RUNNER], moved[RUNNER, :, 0], GOAL_X, seconds)
        dense = np.stack([standing - costs, running])
        shaping = dense.copy()
        shaping[BLOCKER] += np.abs(runner.qpos[:, 0] - GOAL_X) * (verdict.cause != PASSED)
        return dense, shaping
