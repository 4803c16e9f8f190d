"""The part of an observation in which a humanoid feels its own body."""

from __future__ import annotations

from apil_envs.observe import Block, clipped, copied
from apil_envs.robot import Robot

CONTACT_BOUND = 1.0


def humanoid_blocks(robot: Robot) -> list[Block]:
    """What every humanoid game shows after the own position: 332 columns."""
    return [
        copied("velocity", robot.qvel),
        copied("body_inertia", robot.inertia),
        copied("body_velocity", robot.velocity),
        copied("actuator_force", robot.actuator_force),
        clipped("contact_force", robot.contact_force, CONTACT_BOUND),
    ]
