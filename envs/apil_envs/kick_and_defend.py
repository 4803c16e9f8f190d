"""Kick-and-defend: a kicker tries to send the ball through a goal that a keeper guards."""

from __future__ import annotations

import numpy as np

from apil_core import NO_WINNER
from apil_envs import moves
from apil_envs.arrays import Array
from apil_envs.game_base import DIVERGED, GOES_ON, MujocoGame, Verdict
from apil_envs.observe import Block, copied, distance_to, relative
from apil_envs.options import KickAndDefendOptions
from apil_envs.robot import Ball
from apil_envs.senses import humanoid_blocks

KICKER, KEEPER = 0, 1
GOAL_X, GOAL_Y = 4.0, 3.0
PRIZE, BONUS = 1000.0, 500.0
START_X = ((-3.5, -0.5), (1.6, 3.5))
START_Y = (-2.0, 2.0)
BALL_X, BALL_Y, BALL_Z = (-2.0, 1.0), (-4.0, 4.0), 0.35

CAUSES = (
    "goal",
    "ball-outside",
    "ball-turned-back",
    "both-down",
    "time-up",
    "keeper-left-goal",
    DIVERGED,
)
GOAL, OUTSIDE, TURNED_BACK, BOTH_DOWN, TIME_UP, LEFT_GOAL = range(6)


def decide(
    ball: Array, ball_velocity: Array, heights: Array, keeper_x: Array, touched: Array, time_up: Array
) -> Verdict:
    """The rules, as a pure function of the state and earlier touches.

    Args:
        ball: position, (n, 3), m.
        ball_velocity: linear, (n, 3), m/s.
        heights: of the roots of kicker and keeper, (2, n), m.
        keeper_x: of the keeper's root, (n,), m.
        touched: the keeper touched the ball earlier in this game, (n,) bool.
        time_up: (n,) bool.
    """
    past = ball[:, 0] > GOAL_X
    speed = np.sqrt(np.square(ball_velocity).sum(1))
    # the first condition that holds names the ending; the order matters for the outcome only around "saved"
    endings = [
        past & (np.abs(ball[:, 1]) <= GOAL_Y),
        past,
        (ball_velocity[:, 0] < 0) & (speed > 1),
        (heights[KICKER] < 0.8) & (heights[KEEPER] <= 0.5),
        time_up,
        np.abs(GOAL_X - keeper_x) > 2.5,
    ]
    cause = np.select(endings, range(len(endings)), GOES_ON).astype(np.int8)
    scored, left = cause == GOAL, cause == LEFT_GOAL
    saved = (cause > GOAL) & ~left
    winner = np.select([scored, saved], [KICKER, KEEPER], NO_WINNER).astype(np.int8)
    bonus = BONUS * touched + BONUS * (heights[KEEPER] > 0.8)
    kicker = PRIZE * scored - PRIZE * saved
    keeper = np.select([scored | left, saved], [-PRIZE, PRIZE + bonus], 0.0)
    return Verdict(cause, winner, np.stack([kicker, keeper]))


class KickAndDefend(MujocoGame):
    """Side 0 is the kicker, side 1 the keeper; see docs/games.md for rules and observation order."""

    scene = "kick-and-defend"
    side_names = ("kicker", "keeper")
    causes = CAUSES
    touch = ("agent1/torso", "ball")
    options_model = KickAndDefendOptions

    def set_up(self) -> None:
        """The ball, and whether the keeper touched it."""
        self.ball = Ball(self.physics)
        self.touched = np.zeros(self.num_envs, bool)

    def observation_blocks(self, side: int) -> list[Block]:
        """384 columns; positions exclude the own x and y, the ball's velocity is not included."""
        own, other = self.robots[side], self.robots[1 - side]
        return [
            copied("position", own.qpos[:, 2:]),
            *humanoid_blocks(own),
            relative("opponent_xy", other.qpos[:, :2], own.qpos[:, :2], about_opponent=True),
            copied("opponent_position", other.qpos[:, 2:], about_opponent=True),
            relative("ball_xy", self.ball.position[:, :2], own.qpos[:, :2]),
            copied("ball_height", self.ball.position[:, 2:]),
            distance_to("goal_distance", [GOAL_X], self.ball.position[:, :1]),
            distance_to("left_post_distance", [GOAL_Y], self.ball.position[:, 1:2]),
            distance_to("right_post_distance", [-GOAL_Y], self.ball.position[:, 1:2]),
        ]

    def place(self, rows: Array, rng: np.random.Generator) -> None:
        """Noise on everything, then both players and the ball at random places."""
        super().place(rows, rng)
        n = len(rows)
        for robot, bounds in zip(self.robots, START_X, strict=True):
            robot.qpos[rows, 0] = rng.uniform(*bounds, n)
            robot.qpos[rows, 1] = rng.uniform(*START_Y, n)
        ball = self.ball
        ball.position[rows] = np.stack(
            [rng.uniform(*BALL_X, n), rng.uniform(*BALL_Y, n), np.full(n, BALL_Z)], axis=1
        )
        # the ball never starts by rolling away from the goal
        ball.velocity[rows[ball.velocity[rows, 0] < 0]] = 0.1
        self.touched[rows] = False

    def judge(self) -> Verdict:
        """See :func:`decide`; a touch in the current step counts."""
        self.touched |= self.touching
        time_up = self.clock >= self.max_steps
        keeper_x = self.robots[KEEPER].qpos[:, 0]
        return decide(self.ball.position, self.ball.velocity, self.heights, keeper_x, self.touched, time_up)

    def move_rewards(self, moved: Array, verdict: Verdict) -> tuple[Array, Array]:
        """See docs/games.md; shaping adds the ball's distance to the goal plane until the game ends."""
        kicker, keeper = self.robots
        costs = [
            moves.control_cost(robot.ctrl) + moves.contact_cost(robot.contact_force) for robot in self.robots
        ]
        to_ball = moves.distance(self.ball.position[:, :2], kicker.qpos[:, :2])
        guarding = (keeper.height >= moves.STANDING) & (keeper.qpos[:, 0] <= GOAL_X + 0.05)
        guarding &= np.abs(keeper.qpos[:, 1]) <= GOAL_Y
        dense = np.stack(
            [
                moves.forward(moved[KICKER, :, 0], self.physics.seconds_per_step)
                + moves.survive(kicker.height >= moves.STANDING)
                - to_ball
                - costs[KICKER],
                moves.survive(guarding) - costs[KEEPER],
            ]
        )
        to_goal = np.abs(self.ball.position[:, 0] - GOAL_X) * (verdict.cause == GOES_ON)
        return dense, dense + np.stack([-to_goal, to_goal])

    def rule_state(self) -> dict[str, Array]:
        """True where the keeper touched the ball."""
        return {"touched": self.touched}
