"""Options of the games, as data: importable without mujoco, for ``apil config`` and ``apil games``."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from apil_core import Section

InertiaRule = Literal["legacy", "modern"]
"""How a capsule is weighed; see :mod:`apil_envs.inertia`."""


class PhysicsOptions(Section):
    """How the physics is computed; the defaults are the physics the pretrained agents know."""

    inertia: InertiaRule = "legacy"
    """Capsules weighed as in MuJoCo 1.31 (legacy) or as today (modern)."""
    solver: Literal["PGS", "Newton"] = "PGS"
    """Constraint solver."""
    integrator: Literal["RK4", "Euler", "implicitfast"] = "RK4"
    """Time integrator; Euler with Newton is about four times as fast."""
    timestep: Annotated[float, Field(gt=0)] = 0.003
    """Seconds of one physics substep."""
    substeps: Annotated[int, Field(gt=0)] = 5
    """Physics substeps of one control step."""
    max_steps: Annotated[int, Field(gt=0)] = 500
    """Control steps after which a game's time is up."""


class KickAndDefendOptions(PhysicsOptions):
    """Options of kick-and-defend."""


class YouShallNotPassOptions(PhysicsOptions):
    """Options of you-shall-not-pass."""


class SumoOptions(PhysicsOptions):
    """Options of sumo-humans and sumo-ants."""

    auto_contact: bool = False
    """Count the two as having touched from the start; off: who loses before any touch gives a tie."""
    untouched_reward: float = 0.0
    """Sparse reward of a side whose opponent lost before any touch; APL's code trains ants with -1000."""


class RunToGoalHumansOptions(PhysicsOptions):
    """Options of run-to-goal-humans."""


class RunToGoalAntsOptions(PhysicsOptions):
    """Options of run-to-goal-ants."""

    timestep: Annotated[float, Field(gt=0)] = 0.01
    """Seconds of one physics substep."""
