"""Run-to-goal: two runners start face to face; the first across the line behind the other wins."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np

from apil_core import NO_WINNER
from apil_envs import moves
from apil_envs.arrays import Array
from apil_envs.game_base import DIVERGED, GOES_ON, MujocoGame, Verdict
from apil_envs.observe import Block
from apil_envs.options import RunToGoalAntsOptions, RunToGoalHumansOptions
from apil_envs.senses import CONTACT_BOUND, ant_blocks, duel_blocks, humanoid_blocks

GOALS = (4.0, -4.0)
"""x of the line each side runs for, m."""
PRIZE = 1000.0
ANT_STANDING = 0.28

CAUSES = ("runner_0-arrived", "runner_1-arrived", "both-arrived", "both-down", "time-up", DIVERGED)


def decide(centres: Array, down: Array, time_up: Array) -> Verdict:
    """The rules, as a pure function of the state.

    Args:
        centres: x of both mass centres, (2, n), m.
        down: the runner is down, (2, n) bool.
        time_up: (n,) bool.
    """
    arrived = np.stack([centres[0] > GOALS[0], centres[1] < GOALS[1]])
    alone = arrived & ~arrived[::-1]
    endings = [alone[0], alone[1], arrived.all(0), down.all(0), time_up]
    cause = np.select(endings, range(len(endings)), GOES_ON).astype(np.int8)
    winner = np.select(list(alone), [0, 1], NO_WINNER).astype(np.int8)
    return Verdict(cause, winner, PRIZE * alone - PRIZE * alone[::-1])


class RunToGoal(MujocoGame):
    """Base of both games; both sides have the same observations and actions, in opposite directions."""

    side_names = ("runner_0", "runner_1")
    causes = CAUSES

    def judge(self) -> Verdict:
        """See :func:`decide`."""
        centres = np.stack([robot.centre[:, 0] for robot in self.robots])
        return decide(centres, self.down(), self.clock >= self.max_steps)

    def move_rewards(self, moved: Array, verdict: Verdict) -> tuple[Array, Array]:
        """See docs/games.md; no shaping beyond."""
        dense = np.stack([self.run(side, moved[side, :, 0]) for side in (0, 1)])
        return dense, dense

    @abstractmethod
    def down(self) -> Array:
        """True where a runner is down, (2, n) bool."""

    @abstractmethod
    def run(self, side: int, moved: Array) -> Array:
        """Dense reward of one side, (n,); ``moved`` is its displacement along x in this step, (n,), m."""


class RunToGoalHumans(RunToGoal):
    """Two humanoids; see docs/games.md for rules and observation order."""

    scene = "run-to-goal-humans"
    options_model = RunToGoalHumansOptions

    def observation_blocks(self, side: int) -> list[Block]:
        """380 columns."""
        return duel_blocks(self.robots[side], self.robots[1 - side], humanoid_blocks)

    def down(self) -> Array:
        """Below 0.8 m."""
        return self.heights < 0.8

    def run(self, side: int, moved: Array) -> Array:
        """As the runner of you-shall-not-pass."""
        actions, seconds = self.raw_actions[side], self.physics.seconds_per_step
        return moves.run(self.robots[side], actions, moved, GOALS[side], seconds)


class RunToGoalAnts(RunToGoal):
    """Two ants; see docs/games.md for rules and observation order."""

    scene = "run-to-goal-ants"
    options_model = RunToGoalAntsOptions

    def observation_blocks(self, side: int) -> list[Block]:
        """122 columns."""
        return duel_blocks(self.robots[side], self.robots[1 - side], ant_blocks)

    def down(self) -> Array:
        """Below 0.28 m."""
        return self.heights < ANT_STANDING

    def run(self, side: int, moved: Array) -> Array:
        """Speed, less half of Σa² and of Σ of squared clipped forces · 10⁻³, plus or minus 1."""
        robot = self.robots[side]
        forces = np.clip(robot.contact_force, -CONTACT_BOUND, CONTACT_BOUND)
        return (
            np.sign(GOALS[side]) * moved / self.physics.seconds_per_step
            - moves.control_cost(self.raw_actions[side], weight=0.5)
            - 0.5e-3 * np.einsum("nk,nk->n", forces, forces)
            + moves.survive(robot.height >= ANT_STANDING, reward=1.0)
        )
