"""Options of the games, as data: importable without mujoco, for ``apil config`` and ``apil games``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from apil_core import ProfiledOptions

InertiaRule = Literal["legacy", "modern"]
"""Rule for the mass of a capsule; see :mod:`apil_envs.inertia`."""

Solver = Literal["PGS", "Newton"]
Integrator = Literal["RK4", "Euler", "implicitfast", "leapfrog"]
"""MuJoCo's own, and :mod:`apil_envs.leapfrog`."""


@dataclass(frozen=True)
class PhysicsProfile:
    """Settings that determine the cost of a control step. Values of a released profile never change.

    Attributes:
        solver: of the constraints.
        integrator: over time.
        timestep: of one physics substep, s.
        substeps: per control step.
        refresh: recompute fields that depend on position and velocity after the last substep. RK4 leaves them
            at the new state anyway, the others up to a substep behind.
    """

    solver: Solver
    integrator: Integrator
    timestep: float
    substeps: int
    refresh: bool


_FAITHFUL = PhysicsProfile("PGS", "RK4", 0.003, 5, refresh=False)
_FAST = PhysicsProfile("Newton", "leapfrog", 0.003, 5, refresh=False)
"""The cheapest setting measured that keeps the published agents' win and tie rates (docs/fidelity.md)."""
_FAST_RUNNERS = replace(_FAST, timestep=0.0025, substeps=6)
"""Running humanoids are more sensitive to the timestep than the others."""


class PhysicsOptions(ProfiledOptions):
    """Physics settings; the defaults are the physics the pretrained agents were trained in."""

    profiles: ClassVar[Mapping[str, PhysicsProfile]] = {"faithful": _FAITHFUL, "fast": _FAST}

    inertia: InertiaRule = "legacy"
    """Mass of capsules as in MuJoCo 1.31 (legacy) or as today (modern)."""
    solver: Solver | None = None
    """Constraint solver; null: as the profile says."""
    integrator: Integrator | None = None
    """Time integrator; null: as the profile says."""
    timestep: Annotated[float, Field(gt=0)] | None = None
    """Seconds of one physics substep; null: as the profile says."""
    substeps: Annotated[int, Field(gt=0)] | None = None
    """Physics substeps of one control step; null: as the profile says."""
    refresh: bool | None = None
    """Recompute derived quantities after the last substep; null: as the profile says."""
    max_steps: Annotated[int, Field(gt=0)] = 500
    """Control steps until time-out."""

    @property
    def resolved(self) -> PhysicsProfile:
        """The profile with its values overridden by those set in these options."""
        return PhysicsProfile(**self.profile_values())


class KickAndDefendOptions(PhysicsOptions):
    """Options of kick-and-defend."""


class YouShallNotPassOptions(PhysicsOptions):
    """Options of you-shall-not-pass."""

    profiles: ClassVar[Mapping[str, PhysicsProfile]] = {"faithful": _FAITHFUL, "fast": _FAST_RUNNERS}


class SumoOptions(PhysicsOptions):
    """Options of sumo-humans and sumo-ants."""

    auto_contact: bool = False
    """Count the two as having touched from the start; off: a loss before any touch is a tie."""
    untouched_reward: float = 0.0
    """Sparse reward of a side whose opponent lost before any touch; APL's code trains ants with -1000."""


class RunToGoalHumansOptions(PhysicsOptions):
    """Options of run-to-goal-humans."""

    profiles: ClassVar[Mapping[str, PhysicsProfile]] = {"faithful": _FAITHFUL, "fast": _FAST_RUNNERS}


class RunToGoalAntsOptions(PhysicsOptions):
    """Options of run-to-goal-ants."""

    profiles: ClassVar[Mapping[str, PhysicsProfile]] = {
        "faithful": replace(_FAITHFUL, timestep=0.01),
        "fast": replace(_FAST, timestep=0.01),
    }
