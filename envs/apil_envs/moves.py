"""The dense reward terms the games share (docs/games.md, "Outcomes and rewards"); everything is (n,)."""

from __future__ import annotations

import numpy as np

from apil_envs.arrays import Array
from apil_envs.robot import Robot

CONTROL_WEIGHT = 0.1
CONTACT_WEIGHT = 0.5e-6
CONTACT_LIMIT = 10.0
SURVIVE = 5.0
STANDING = 1.0
"""Height above its ground (m) from which a humanoid counts as standing."""
FORWARD_WEIGHT = 1.25
"""Per m/s. The originals take 0.25 · Δx/0.003 s with Δx over five substeps of 0.003 s."""


def control_cost(actions: Array, weight: float = CONTROL_WEIGHT) -> Array:
    """``weight`` · Σa², from (n, a)."""
    return weight * np.einsum("na,na->n", actions, actions)


def contact_cost(forces: Array) -> Array:
    """min(0.5e-6 Σf², 10), from unclipped contact forces (n, k)."""
    return np.minimum(CONTACT_WEIGHT * np.einsum("nk,nk->n", forces, forces), CONTACT_LIMIT)


def survive(alive: Array, reward: float = SURVIVE) -> Array:
    """``+reward`` where ``alive``, else ``-reward``."""
    return np.where(alive, reward, -reward)


def forward(distance: Array, seconds: float) -> Array:
    """Reward of moving ``distance`` (m) towards the goal within one control step."""
    return FORWARD_WEIGHT * distance / seconds


def distance(points: Array, others: Array | float = 0.0) -> Array:
    """Distance in the plane between ``points`` (n, 2) and ``others`` (n, 2), or from the origin; (n,), m."""
    return np.sqrt(np.square(points - others).sum(1))


def run(robot: Robot, actions: Array, moved: Array, goal: float, seconds: float) -> Array:
    """Dense reward of a humanoid per step for running towards the line x = ``goal``.

    Args:
        robot: the runner's.
        actions: not clipped, (n, a).
        moved: displacement of its mass centre along x in this step, (n,), m.
        goal: x of the line, m; the runner starts on the other side of 0.
        seconds: length of the step.
    """
    return (
        forward(np.sign(goal) * moved, seconds)
        - control_cost(actions)
        - contact_cost(robot.contact_force)
        + survive(robot.height >= STANDING)
        - np.abs(robot.qpos[:, 0] - goal)
    )
