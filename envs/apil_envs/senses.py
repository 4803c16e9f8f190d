"""Observation blocks of a robot: its own body and its opponent's position."""

from __future__ import annotations

from collections.abc import Callable

from apil_envs.observe import Block, clipped, copied
from apil_envs.robot import Robot

CONTACT_BOUND = 1.0


def humanoid_blocks(robot: Robot) -> list[Block]:
    """Blocks of every humanoid game after the own position: 332 columns."""
    return [
        copied("velocity", robot.qvel),
        copied("body_inertia", robot.inertia),
        copied("body_velocity", robot.velocity),
        copied("actuator_force", robot.actuator_force),
        clipped("contact_force", robot.contact_force, CONTACT_BOUND),
    ]


def ant_blocks(robot: Robot) -> list[Block]:
    """Blocks of every ant game after the own position: 92 columns."""
    return [copied("velocity", robot.qvel), clipped("contact_force", robot.contact_force, CONTACT_BOUND)]


def duel_blocks(own: Robot, other: Robot, body: Callable[[Robot], list[Block]]) -> list[Block]:
    """Own position, the own body as ``body`` shows it, and the opponent's position."""
    return [
        copied("position", own.qpos),
        *body(own),
        copied("opponent_position", other.qpos, about_opponent=True),
    ]
