"""One side's robot in all simulations, as live arrays."""

from __future__ import annotations

import mujoco
import numpy as np

from apil_envs.arrays import Array
from apil_envs.physics import Physics


class Robot:
    """Live views of side ``side``'s robot; ``n`` is the number of games, all float64.

    Attributes:
        qpos: (n, 24) humanoid, (n, 15) ant: root position 3, root quaternion 4, joints.
        qvel: (n, 23) or (n, 14).
        ctrl: (n, actions), writable.
        inertia: ``cinert`` of its 13 bodies, (n, 130).
        velocity: ``cvel``, (n, 78).
        actuator_force: ``qfrc_actuator``, (n, 23) or (n, 14).
        contact_force: ``cfrc_ext``, (n, 78), unclipped.
        torso_rotation: ``xmat`` of the root, (n, 9).
        centre: mass centre of the whole robot, (n, 3), m.
        bounds: of every control, (low, high).
    """

    def __init__(self, physics: Physics, side: int):
        model = physics.model
        prefix = f"agent{side}/"
        bodies = [b for b in range(model.nbody) if model.body(b).name.startswith(prefix)]
        joints = [j for j in range(model.njnt) if model.joint(j).name.startswith(prefix)]
        motors = [a for a in range(model.nu) if model.actuator(a).name.startswith(prefix)]
        root = bodies[0]
        hinges = len(joints) - 1
        position = slice(model.jnt_qposadr[joints[0]], model.jnt_qposadr[joints[0]] + 7 + hinges)
        velocity = slice(model.jnt_dofadr[joints[0]], model.jnt_dofadr[joints[0]] + 6 + hinges)

        def per_body(name: str, width: int, last: int = bodies[-1]) -> Array:
            return physics.field(name)[:, width * root : width * (last + 1)]

        self.qpos = physics.qpos[:, position]
        self.qvel = physics.qvel[:, velocity]
        self.ctrl = physics.ctrl[:, motors[0] : motors[-1] + 1]
        self.inertia = per_body("cinert", 10)
        self.velocity = per_body("cvel", 6)
        self.actuator_force = physics.field("qfrc_actuator")[:, velocity]
        self.contact_force = per_body("cfrc_ext", 6)
        self.torso_rotation = per_body("xmat", 9, root)
        self.centre = per_body("subtree_com", 3, root)
        low, high = model.actuator_ctrlrange[motors[0]]
        self.bounds = (float(low), float(high))

    @property
    def height(self) -> Array:
        """Height of the root, (n,), m."""
        return self.qpos[:, 2]


class Ball:
    """Live views of the ball: ``position`` (n, 3) in m, ``velocity`` (n, 3) linear in m/s."""

    def __init__(self, physics: Physics):
        joint = physics.model.joint("ball")
        assert joint.type[0] == mujoco.mjtJoint.mjJNT_FREE
        self.position = physics.qpos[:, joint.qposadr[0] : joint.qposadr[0] + 3]
        self.velocity = physics.qvel[:, joint.dofadr[0] : joint.dofadr[0] + 3]

    @property
    def speed(self) -> Array:
        """Length of the linear velocity, (n,), m/s."""
        return np.sqrt(np.square(self.velocity).sum(1))
