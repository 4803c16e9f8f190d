"""MuJoCo's semi-implicit Euler made second-order, with one evaluation of the forces per substep.

Plain Euler has a first-order error in the timestep h, which changes the agents' scores (docs/fidelity.md).
Three sources of that error can be removed without computing anything more:

- **Positions.** ``v += h a(x)``, ``x += h v`` is the leapfrog scheme, of second order, if ``x`` is read as
  the position half a step ahead of ``v`` (Verlet 1967). So the simulation keeps it half a step ahead, and
  what the game reads and writes is moved back by ``h v / 2``.
- **Joint damping** D by the midpoint rule, ``M (v' - v) / h = f - D (v + v') / 2``: the same as an explicit
  step with ``M + h D / 2`` for M, and D is diagonal, as the armature is.
- **Contacts and joint limits** pull as critically damped springs of rate ω. Their stiffness and damping are
  set so that one such step takes a free spring where the exact solution takes it in h.
"""

from __future__ import annotations

import mujoco
import numpy as np

from apil_core import ConfigError
from apil_envs.arrays import Array, Rows

_CONSTRAINTS = ("geom", "jnt", "pair")


def tune(model: mujoco.MjModel) -> None:
    """Set damping, contacts and limits of a model for steps of its own timestep; changes it in place.

    The softness of contacts that MuJoCo derives from the inertia (``invweight0``) keeps its compiled values.
    """
    step = float(model.opt.timestep)
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP)
    for inertia in (model.dof_armature, model.dof_M0):  # M0: bodies whose inertia never changes
        inertia[:] += 0.5 * step * model.dof_damping
    for kind in _CONSTRAINTS:
        reference, impedance = getattr(model, f"{kind}_solref"), getattr(model, f"{kind}_solimp")
        reference[:] = matched(reference, impedance[:, 1], step)


def matched(reference: Array, largest: Array, step: float) -> Array:
    """``solref`` (time constant, damping ratio) whose discrete motion is the continuous one of ``reference``.

    With d the largest impedance, MuJoCo's spring has damping b = 2 / (d τ) and stiffness k = 1 / (d τ ζ)²;
    critically damped (ζ = 1) that is b = 2 ω, k = ω², ω = 1 / (d τ). One step of leapfrog multiplies a free
    motion by e^(-ω h), as exactly as time does, with b = (1 - e^(-2 ω h)) / h and k = ((1 - e^(-ω h)) / h)².

    Args:
        reference: (m, 2), damping ratios 1.
        largest: d of each, (m,).
        step: h, s.

    Raises:
        ConfigError: a spring is given by other numbers, or is not critically damped.
    """
    constant, ratio = reference.T
    odd = ~((constant > 0) & (ratio == 1))
    if odd.any():
        first = reference[odd][0].tolist()
        raise ConfigError(
            f"integrator leapfrog needs critically damped contacts, solref [time, 1], got {first}"
        )
    decay = np.exp(-step / (largest * constant))
    damping, root = (1 - decay**2) / step, (1 - decay) / step
    slower = 2 / (largest * damping)
    return np.stack([slower, 1 / (root * largest * slower)], axis=1)


class Shift:
    """Moves positions along velocities, for all joints of a model.

    Args:
        model: with free, hinge and slide joints only.
    """

    def __init__(self, model: mujoco.MjModel):
        free = model.jnt_type == mujoco.mjtJoint.mjJNT_FREE
        turns = [np.arange(3) + start for start in model.jnt_dofadr[free]]
        places = [np.arange(3) + start for start in model.jnt_qposadr[free]]
        self._velocities = np.concatenate([model.jnt_dofadr[~free], *turns])
        self._positions = np.concatenate([model.jnt_qposadr[~free], *places])
        self._quaternions = model.jnt_qposadr[free][:, None] + np.arange(3, 7)
        self._turns = model.jnt_dofadr[free][:, None] + np.arange(3, 6)

    def __call__(self, source: Array, target: Array, qvel: Array, rows: Rows, seconds: float) -> None:
        """Write ``rows`` of ``source`` (n, nq) into ``target``, moved by ``seconds`` · ``qvel`` (n, nv)."""
        moved, velocity = source[rows].copy(), qvel[rows]
        moved[:, self._positions] += seconds * velocity[:, self._velocities]
        roots = self._quaternions
        moved[:, roots] = turned(moved[:, roots], seconds * velocity[:, self._turns])
        target[rows] = moved


def turned(quaternions: Array, rotations: Array) -> Array:
    """Unit ``quaternions`` (..., 4) after rotation vectors (..., 3), rad, in their own frames; (..., 4)."""
    angle = np.sqrt(np.square(rotations).sum(-1))
    c = np.cos(0.5 * angle)
    # sin(angle / 2) / angle, which numpy's sinc has at 0 too
    scale = 0.5 * np.sinc(angle / (2 * np.pi))
    i, j, k = (scale * rotations[..., axis] for axis in range(3))
    w, x, y, z = (quaternions[..., part] for part in range(4))
    product = np.empty_like(quaternions)  # Hamilton's; np.cross costs several times as much
    product[..., 0] = w * c - x * i - y * j - z * k
    product[..., 1] = w * i + x * c + y * k - z * j
    product[..., 2] = w * j - x * k + y * c + z * i
    product[..., 3] = w * k + x * j - y * i + z * c
    return product
