"""Five games a second time, one at a time: observations and dense rewards from a plain ``MjData``.

Written from the description of the original games alone. Shares nothing with the package but the names of
bodies and joints, so that a slip in one of the two shows.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np

HUMANOID_FEELS = {
    "position": 24,
    "velocity": 23,
    "body_inertia": 130,
    "body_velocity": 78,
    "actuator_force": 23,
    "contact_force": 78,
    "opponent_position": 24,
}
ANT_FEELS = {"position": 15, "velocity": 14, "contact_force": 78, "opponent_position": 15}
RING = {
    "opponent_xy": 2,
    "torso_rotation": 9,
    "ring_radius": 1,
    "own_edge_distance": 1,
    "opponent_edge_distance": 1,
    "time_left": 1,
}
ABOUT_OPPONENT = ("opponent_position", "opponent_xy", "opponent_edge_distance")
RING_TOP = 0.5


@dataclass(frozen=True)
class OneGame:
    """What one simulation shows after a step.

    Attributes:
        model, data: as the last substep left them; the ring's radius stands in ``model.geom_size``.
        step: number of steps played.
        actions: of both sides in that step, not clipped.
        before: mass centres of both sides along x before that step, (2,), m.
    """

    model: mujoco.MjModel
    data: mujoco.MjData
    step: int = 0
    actions: tuple[np.ndarray, ...] = ()
    before: np.ndarray | None = None

    def bodies(self, side: int) -> list[int]:
        model = self.model
        return [b for b in range(model.nbody) if model.body(b).name.startswith(f"agent{side}/")]

    def position(self, side: int) -> np.ndarray:
        hinges = (self.model.nq - 14) // 2
        start = self.model.joint(f"agent{side}/root").qposadr[0]
        return self.data.qpos[start : start + 7 + hinges]

    def dofs(self, side: int) -> slice:
        hinges = (self.model.nv - 12) // 2
        start = self.model.joint(f"agent{side}/root").dofadr[0]
        return slice(start, start + 6 + hinges)

    def forces(self, side: int) -> np.ndarray:
        return np.concatenate([self.data.cfrc_ext[b] for b in self.bodies(side)])

    def centres(self) -> np.ndarray:
        """Mass centres of both sides along x, (2,), m: the originals' "torso", also of ants."""
        rows = []
        for side in (0, 1):
            bodies = self.bodies(side)
            mass = self.model.body_mass[bodies]
            rows.append(mass @ self.data.xipos[bodies, 0] / mass.sum())
        return np.array(rows)

    def distance(self, side: int) -> float:
        """Of the root from the middle, m."""
        x, y = self.position(side)[:2]
        return float(np.sqrt(x * x + y * y))

    @property
    def radius(self) -> float:
        return float(self.model.geom("arena").size[0])


def feel(game: OneGame, side: int) -> dict[str, np.ndarray]:
    """Blocks of the games on open ground, by name; a superset of what ants see."""
    data, bodies = game.data, game.bodies(side)
    return {
        "position": game.position(side),
        "velocity": data.qvel[game.dofs(side)],
        "body_inertia": np.concatenate([data.cinert[b] for b in bodies]),
        "body_velocity": np.concatenate([data.cvel[b] for b in bodies]),
        "actuator_force": data.qfrc_actuator[game.dofs(side)],
        "contact_force": game.forces(side).clip(-1, 1),
        "opponent_position": game.position(1 - side),
    }


def feel_ring(game: OneGame, side: int) -> dict[str, np.ndarray]:
    """Blocks that sumo adds."""
    own, other = game.position(side), game.position(1 - side)
    return {
        "opponent_xy": other[:2] - own[:2],
        "torso_rotation": game.data.xmat[game.bodies(side)[0]],
        "ring_radius": np.array([game.radius]),
        "own_edge_distance": np.array([game.radius - game.distance(side)]),
        "opponent_edge_distance": np.array([game.radius - game.distance(1 - side)]),
        "time_left": np.array([500.0 - game.step]),
    }


def contact_cost(game: OneGame, side: int) -> float:
    return min(0.5e-6 * float(np.square(game.forces(side)).sum()), 10)


def survive(alive: bool) -> float:
    return 5 if alive else -5


def running(game: OneGame, side: int, goal: float) -> float:
    """A humanoid on its way to the line x = ``goal``."""
    x, _, z = game.position(side)[:3]
    forward = 0.25 * (game.centres()[side] - game.before[side]) / 0.003 * np.sign(goal)
    control = 0.1 * float(np.square(game.actions[side]).sum())
    return forward - control - contact_cost(game, side) + survive(z >= 1) - abs(x - goal)


def you_shall_not_pass(game: OneGame) -> tuple[list[float], list[float]]:
    blocker = survive(game.position(0)[2] >= 1) - contact_cost(game, 0)
    blocker -= 0.1 * float(np.square(game.actions[0]).sum())
    runner = running(game, 1, -4)
    return [blocker, runner], [blocker + abs(game.position(1)[0] + 4), runner]


def run_to_goal_humans(game: OneGame) -> tuple[list[float], list[float]]:
    rewards = [running(game, 0, 4), running(game, 1, -4)]
    return rewards, rewards


def run_to_goal_ants(game: OneGame) -> tuple[list[float], list[float]]:
    rewards = []
    for side, direction in ((0, 1), (1, -1)):
        forward = direction * (game.centres()[side] - game.before[side]) / 0.05
        control = 0.5 * float(np.square(game.actions[side]).sum())
        contact = 0.5e-3 * float(np.square(game.forces(side).clip(-1, 1)).sum())
        alive = 1 if game.position(side)[2] >= 0.28 else -1
        rewards.append(forward - control - contact + alive)
    return rewards, rewards


def sumo(game: OneGame, standing: float, bound: float) -> tuple[list[float], list[float]]:
    """``bound``: of the actions that count as control cost."""
    rewards = []
    for side in (0, 1):
        z = game.position(side)[2]
        control = 0.1 * float(np.square(game.actions[side].clip(-bound, bound)).sum())
        alive = survive(z - RING_TOP >= standing)
        rewards.append(-game.distance(side) - control - contact_cost(game, side) + alive)
    return rewards, rewards


@dataclass(frozen=True)
class Described:
    """A game of the description.

    Attributes:
        order: blocks of the observation and their widths.
        rewards: (dense, shaping) of both sides.
        height: to put both roots at, so that the feet soon touch the ground, m.
        apart: distance of the roots along x that brings limbs within reach, m.
        action_size, bound: of the controls.
    """

    name: str
    order: dict[str, int]
    rewards: Callable[[OneGame], tuple[list[float], list[float]]]
    height: float
    apart: float
    action_size: int = 17
    bound: float = 0.4

    def observe(self, game: OneGame, side: int) -> np.ndarray:
        parts = feel(game, side)
        if "ring_radius" in self.order:
            parts |= feel_ring(game, side)
        return np.concatenate([parts[name] for name in self.order])


DESCRIBED = (
    Described("you-shall-not-pass", HUMANOID_FEELS, you_shall_not_pass, 1.4, 0.45),
    Described("sumo-humans", HUMANOID_FEELS | RING, lambda game: sumo(game, 1.0, 0.4), 1.9, 0.45),
    Described("sumo-ants", ANT_FEELS | RING, lambda game: sumo(game, 0.28, np.inf), 1.2, 1.0, 8, 1.0),
    Described("run-to-goal-humans", HUMANOID_FEELS, run_to_goal_humans, 1.4, 0.45),
    Described("run-to-goal-ants", ANT_FEELS, run_to_goal_ants, 0.7, 1.0, 8, 1.0),
)
SIZES = {
    "you-shall-not-pass": 380,
    "sumo-humans": 395,
    "sumo-ants": 137,
    "run-to-goal-humans": 380,
    "run-to-goal-ants": 122,
}
