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
