"""Batch of simulations of one scene: bind once, step, reset some, detect divergence."""

from __future__ import annotations

import sys

import mujoco
import numpy as np
from mujoco.batch import Batch

from apil_envs.arrays import ALL, Array, Rows
from apil_envs.leapfrog import Shift
from apil_envs.options import PhysicsProfile
from apil_envs.stopwatch import BatchStopwatch

_BAD = [
    int(kind)
    for kind in (
        mujoco.mjtWarning.mjWARN_BADQPOS,
        mujoco.mjtWarning.mjWARN_BADQVEL,
        mujoco.mjtWarning.mjWARN_BADQACC,
    )
]
_told: set[str] = set()


def _tell(text: str) -> None:
    """Print each kind of warning once on stderr, instead of MuJoCo's MUJOCO_LOG.TXT in the user's folder."""
    kind = text.partition(" Time =")[0]
    if kind not in _told:
        _told.add(kind)
        print(f"MuJoCo: {kind}", file=sys.stderr)


mujoco.set_mju_user_warning(_tell)


class Physics:
    """``num_envs`` simulations stepped by a thread pool, bit-identical at any thread count.

    Derived fields (everything but qpos, qvel and ctrl) are those of the last substep, as in the original
    games: there is no forward pass after a step, unless the profile refreshes the fields that depend on
    position and velocity.

    Args:
        model: the compiled scene.
        num_envs: number of simulations.
        threads: of the pool (0: all CPUs).
        profile: the scene was compiled for.

    Attributes:
        model: as given.
        num_envs: number of simulations.
        qpos, qvel, ctrl: live state, (num_envs, nq | nv | nu), float64. Under leapfrog qpos is a copy, moved
            back by half a substep; writes to it are applied by :meth:`forward`.
    """

    def __init__(self, model: mujoco.MjModel, num_envs: int, threads: int, profile: PhysicsProfile):
        self.model = model
        self.num_envs = num_envs
        self._batch = Batch(model, num_envs, threads)
        self._substeps = profile.substeps
        self._stage = int(mujoco.mjtStage.mjSTAGE_VEL if profile.refresh else mujoco.mjtStage.mjSTAGE_NONE)
        self._shift = Shift(model) if profile.integrator == "leapfrog" else None
        self._simulated = self._batch.bind("qpos")
        self.qpos = self._simulated if self._shift is None else self._simulated.copy()
        self.qvel = self._batch.bind("qvel")
        self.ctrl = self._batch.bind("ctrl")
        joints = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)
        self._quaternions = [slice(a + 3, a + 7) for a in model.jnt_qposadr[joints]]

    @property
    def seconds_per_step(self) -> float:
        """Simulated time of one control step."""
        return float(self.model.opt.timestep) * self._substeps

    def field(self, name: str) -> Array:
        """Live view of a derived field, flattened to (num_envs, k), float64, read-only."""
        return self._batch.bind(name).reshape(self.num_envs, -1)

    def sensor(self, name: str) -> Array:
        """Live view of one sensor's values, (num_envs, k)."""
        sensor = self.model.sensor(name)
        return self._batch.bind("sensordata")[:, sensor.adr[0] : sensor.adr[0] + sensor.dim[0]]

    def expand(self, name: str) -> Array:
        """Make a model field one value per simulation; returns them, live and writable, (num_envs, ...).

        Constants that MuJoCo derived from the compiled value (bounding radii, masses) are not updated.
        """
        return self._batch.expand(name)

    def row_model(self, row: int, into: mujoco.MjModel | None = None) -> mujoco.MjModel:
        """Copy of the model with the values of one simulation, written to ``into`` if that is given."""
        return self._batch.get_model(row, into)

    def step(self, active: Array | None = None) -> Array:
        """Advance all simulations, or those in ``active`` (num_envs,), by one control step.

        Returns:
            (num_envs,) bool: diverged in this step. Their state is finite again: the model's
            default pose; the caller ends their games.
        """
        before = self._batch.warning[:, _BAD, 1].sum(1)
        self._batch.step(active, nstep=self._substeps, stage=self._stage)
        diverged = self._batch.warning[:, _BAD, 1].sum(1) > before
        # MuJoCo checks the state at the start of the next substep, too late for the last one
        broken = ~np.isfinite(self._batch.state.sum(1))
        if broken.any():
            self.clear(broken)
            self.forward(broken)
        self.show()
        return diverged | broken

    def stopwatch(self) -> BatchStopwatch:
        """Timer of the MuJoCo calls in :meth:`step` alone: it wraps the batch's."""
        return BatchStopwatch(self._batch)

    def clear(self, mask: Array | None = None) -> None:
        """Put simulations into the model's default state without computing anything."""
        self._batch.reset(mask, stage=mujoco.mjtStage.mjSTAGE_NONE)
        if self._shift is not None:
            rows: Rows = ALL if mask is None else np.flatnonzero(mask)
            self.qpos[rows] = self._simulated[rows]

    def show(self) -> None:
        """Update :attr:`qpos` from the simulations, after a write to :attr:`state`."""
        if self._shift is not None:
            self._shift(self._simulated, self.qpos, self.qvel, ALL, -self._half_step)

    @property
    def _half_step(self) -> float:
        return 0.5 * float(self.model.opt.timestep)

    def forward(self, mask: Array | None = None) -> None:
        """Normalise the quaternions of the root poses and compute all derived fields."""
        rows: Rows = ALL if mask is None else np.flatnonzero(mask)
        for part in self._quaternions:
            quaternion = self.qpos[rows, part]
            self.qpos[rows, part] = quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)
        if self._shift is not None:
            self._shift(self.qpos, self._simulated, self.qvel, rows, self._half_step)
        self._batch.forward(mask)

    @property
    def state(self) -> Array:
        """Live integration state, (num_envs, k), float64; assigning to its rows restores bit for bit.

        After that call :meth:`show`; derived fields are stale until the next step, forward or reset.
        """
        return self._batch.state
