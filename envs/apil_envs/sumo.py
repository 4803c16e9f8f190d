"""Sumo: two humanoids or two ants on a round platform; the first to fall or leave the ring loses."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from apil_core import NO_WINNER
from apil_envs import moves
from apil_envs.arrays import Array, Rows
from apil_envs.game_base import DIVERGED, GOES_ON, MujocoGame, Verdict
from apil_envs.observe import Block, computed, copied, distance_to, relative
from apil_envs.options import SumoOptions
from apil_envs.robot import Robot
from apil_envs.senses import ant_blocks, duel_blocks, humanoid_blocks

RING_TOP = 0.5
"""Height of the platform, m."""
PRIZE = 1000.0
START_X = 0.3
"""Nearest to the middle that a fighter starts, m."""

_LOST = [f"fighter_{side}-{how}" for how in ("fell", "left-ring") for side in (0, 1)]
CAUSES = (
    *_LOST[:2],
    "both-fell",
    *_LOST[2:],
    "both-left-ring",
    "time-up",
    *(f"{cause}-untouched" for cause in _LOST),
    DIVERGED,
)
FELL, LEFT_RING, TIME_UP = 0, 3, 6
_UNTOUCHED = np.array([7, 8, 2, 9, 10, 5, 6], np.int8)
"""Cause by index if the two never touched."""


def decide(
    heights: Array,
    distances: Array,
    radius: Array,
    touched: Array,
    time_up: Array,
    *,
    fallen: float,
    untouched_reward: float = 0.0,
) -> Verdict:
    """The rules, as a pure function of the state and earlier touches.

    Args:
        heights: of both roots, (2, n), m.
        distances: of both roots from the ring's centre in the plane, (2, n), m.
        radius: of the ring, (n,), m.
        touched: the two touched in this game, (n,) bool.
        time_up: (n,) bool.
        fallen: height (m) at or below which a fighter has fallen.
        untouched_reward: of the side whose opponent lost before any touch.
    """
    down, out = heights <= fallen, distances > radius
    fell = down.any(0)  # goes before leaving the ring
    lost = np.where(fell, down, out)
    one, both = lost.any(0), lost.all(0)
    who = np.where(both, 2, np.where(lost[0], 0, 1))
    cause = np.select([one, time_up], [np.where(fell, FELL, LEFT_RING) + who, TIME_UP], GOES_ON)
    cause = np.where((cause != GOES_ON) & ~touched, _UNTOUCHED[cause], cause).astype(np.int8)
    winner = np.where(one & ~both & touched, 1 - who, NO_WINNER).astype(np.int8)
    other = np.where(touched, PRIZE, untouched_reward)
    sparse = np.where(lost | (time_up & ~one), -PRIZE, np.where(one, other, 0.0))
    return Verdict(cause, winner, sparse)


class Sumo(MujocoGame):
    """Base of both sumo games; both sides have the same observations and actions.

    Attributes:
        ring: smallest and largest radius of the ring, m; drawn for every game.
        fallen, standing: heights above the ring, m.
        radius: of every game's ring, live, (n,).
        touched: the two touched in this game, (n,) bool.
    """

    side_names = ("fighter_0", "fighter_1")
    causes = CAUSES
    touch = ("agent0/torso", "agent1/torso")
    options_model = SumoOptions
    ring: tuple[float, float]
    fallen: float
    standing: float
    body_blocks: Callable[[Robot], list[Block]]
    options: SumoOptions

    def set_up(self) -> None:
        """The ring's radius, one per simulation."""
        arena = self.physics.model.geom("arena").id
        self.radius = self.physics.expand("geom_size")[:, arena, 0]
        self.touched = np.zeros(self.num_envs, bool)

    def observation_blocks(self, side: int) -> list[Block]:
        """395 columns for humanoids, 137 for ants."""
        own, other = self.robots[side], self.robots[1 - side]
        return [
            *duel_blocks(own, other, self.body_blocks),
            relative("opponent_xy", other.qpos[:, :2], own.qpos[:, :2], about_opponent=True),
            copied("torso_rotation", own.torso_rotation),
            copied("ring_radius", self.radius[:, None]),
            computed("own_edge_distance", self._edge_distance(own)),
            computed("opponent_edge_distance", self._edge_distance(other), about_opponent=True),
            distance_to("time_left", [self.max_steps], self.clock[:, None]),
        ]

    def place(self, rows: Array, rng: np.random.Generator) -> None:
        """Draw a ring; side 0 starts left of its middle, side 1 right, both well inside."""
        super().place(rows, rng)
        smallest, largest = self.ring
        radius = rng.uniform(smallest, largest, len(rows))
        self.radius[rows] = radius
        gap = 0.3 + smallest / 2
        for robot, sign in zip(self.robots, (-1, 1), strict=True):
            x = sign * rng.uniform(START_X, radius - gap)
            y = (np.sqrt(radius**2 - x**2) - gap) * rng.uniform(-1, 1, len(rows))
            robot.qpos[rows, 0], robot.qpos[rows, 1] = x, y
        self.touched[rows] = self.options.auto_contact

    def judge(self) -> Verdict:
        """See :func:`decide`; a touch in the current step counts."""
        self.touched |= self.touching
        distances = np.stack([moves.distance(robot.qpos[:, :2]) for robot in self.robots])
        return decide(
            self.heights,
            distances,
            self.radius,
            self.touched,
            self.clock >= self.max_steps,
            fallen=RING_TOP + self.fallen,
            untouched_reward=self.options.untouched_reward,
        )

    def move_rewards(self, moved: Array, verdict: Verdict) -> tuple[Array, Array]:
        """See docs/games.md; no shaping beyond."""
        dense = np.stack(
            [
                moves.survive(robot.height - RING_TOP >= self.standing)
                - moves.distance(robot.qpos[:, :2])
                - moves.control_cost(self.costly_actions(side))
                - moves.contact_cost(robot.contact_force)
                for side, robot in enumerate(self.robots)
            ]
        )
        return dense, dense

    def costly_actions(self, side: int) -> Array:
        """The actions that the control cost counts, (n, a)."""
        return self.robots[side].ctrl

    def rule_state(self) -> dict[str, Array]:
        """Rings and touches."""
        return {"radius": self.radius, "touched": self.touched}

    def _edge_distance(self, robot: Robot) -> Callable[[Rows], Array]:
        return lambda rows: self.radius[rows] - moves.distance(robot.qpos[rows, :2])


class SumoHumans(Sumo):
    """Two humanoids; see docs/games.md for rules and observation order."""

    scene = "sumo-humans"
    ring = (1.5, 3.5)
    fallen = 0.5
    standing = moves.STANDING
    body_blocks = staticmethod(humanoid_blocks)


class SumoAnts(Sumo):
    """Two ants; see docs/games.md for rules and observation order."""

    scene = "sumo-ants"
    ring = (2.5, 4.5)
    fallen = 0.3
    standing = 0.28
    body_blocks = staticmethod(ant_blocks)

    def costly_actions(self, side: int) -> Array:
        """Control cost of ants, on unclipped actions."""
        return self.raw_actions[side]
