"""Many simulations of one scene: bind once, step, reset some, notice the ones that diverge."""

from __future__ import annotations

import mujoco
import numpy as np
from mujoco.batch import Batch

from apil_envs.arrays import ALL, Array, Rows

_BAD = [
    int(kind)
    for kind in (
        mujoco.mjtWarning.mjWARN_BADQPOS,
        mujoco.mjtWarning.mjWARN_BADQVEL,
        mujoco.mjtWarning.mjWARN_BADQACC,
    )
]


class Physics:
    """``num_envs`` simulations stepped by a thread pool, bit-identical at any thread count.

    Derived fields (everything but qpos, qvel and ctrl) are as the last substep left them, one stage
    behind the state, just as the original games read them: nothing here runs a forward pass after a step.

    Attributes:
        model: the compiled scene.
        num_envs: number of simulations.
        qpos, qvel, ctrl: live state, (num_envs, nq | nv | nu), float64.
    """

    def __init__(self, model: mujoco.MjModel, num_envs: int, threads: int, substeps: int):
        self.model = model
        self.num_envs = num_envs
        self._batch = Batch(model, num_envs, threads)
        self._substeps = substeps
        self.qpos = self._batch.bind("qpos")
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
        """Live view of one sensor's numbers, (num_envs, k)."""
        sensor = self.model.sensor(name)
        return self._batch.bind("sensordata")[:, sensor.adr[0] : sensor.adr[0] + sensor.dim[0]]

    def expand(self, name: str) -> Array:
        """Give a model field one value per simulation; returns them, live and writable, (num_envs, ...).

        Constants that MuJoCo derived from the compiled value (bounding radii, masses) do not follow.
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
        self._batch.step(active, nstep=self._substeps)
        diverged = self._batch.warning[:, _BAD, 1].sum(1) > before
        # MuJoCo looks at the state when the next substep begins, too late for the last one
        broken = ~np.isfinite(self._batch.state.sum(1))
        if broken.any():
            self.clear(broken)
            self.forward(broken)
        return diverged | broken

    def clear(self, mask: Array | None = None) -> None:
        """Put simulations into the model's default state without computing anything."""
        self._batch.reset(mask, stage=mujoco.mjtStage.mjSTAGE_NONE)

    def forward(self, mask: Array | None = None) -> None:
        """Normalise the quaternions of the root poses and compute all derived fields."""
        rows: Rows = ALL if mask is None else np.flatnonzero(mask)
        for part in self._quaternions:
            quaternion = self.qpos[rows, part]
            self.qpos[rows, part] = quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)
        self._batch.forward(mask)

    @property
    def state(self) -> Array:
        """Live integration state, (num_envs, k), float64; assigning to its rows restores bit for bit.

        After that derived fields are stale until the next step, forward or reset.
        """
        return self._batch.state
