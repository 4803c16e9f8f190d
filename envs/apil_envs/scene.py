"""A game's MuJoCo model: two robots, the arena, and the sensors the rules read."""

from __future__ import annotations

from typing import Any

import mujoco

from apil_envs.bodies import add_body, add_geom, add_robot, description
from apil_envs.options import PhysicsOptions

TOUCH = "touch"
"""Name of the contact sensor: (contacts found, smallest distance in m)."""

_COLOURS = ([0.85, 0.3, 0.25, 1.0], [0.25, 0.4, 0.85, 1.0])
_GROUND = [0.8, 0.85, 0.8, 1.0]
_BALL = [0.95, 0.95, 0.9, 1.0]
_NO_DEFAULTS: dict[str, dict[str, Any]] = {"joint": {}, "geom": {}}  # the robots' defaults are theirs alone
_SOLVERS = {"PGS": mujoco.mjtSolver.mjSOL_PGS, "Newton": mujoco.mjtSolver.mjSOL_NEWTON}
_INTEGRATORS = {
    "RK4": mujoco.mjtIntegrator.mjINT_RK4,
    "Euler": mujoco.mjtIntegrator.mjINT_EULER,
    "implicitfast": mujoco.mjtIntegrator.mjINT_IMPLICITFAST,
}


def build_scene(name: str, options: PhysicsOptions, touch: tuple[str, str] | None = None) -> mujoco.MjModel:
    """Compile the scene of a game.

    Args:
        name: key of ``scenes`` in ``bodies.json``.
        options: the physics.
        touch: two bodies; a sensor named :data:`TOUCH` watches contacts between what hangs on each.
    """
    scene = description()["scenes"][name]
    spec = mujoco.MjSpec()
    _set_options(spec, scene["option"], options)
    _add_arena(spec, scene["geoms"])
    for ball in scene["ball"]:
        add_body(spec.worldbody, ball, _NO_DEFAULTS, "", "modern", _BALL)
    for side, pose in enumerate(scene["agents"]):
        add_robot(spec, scene["body"], f"agent{side}/", pose, options.inertia, _COLOURS[side])
    _add_sensors(spec, touch)
    return spec.compile()


def _set_options(spec: mujoco.MjSpec, scene: dict[str, Any], options: PhysicsOptions) -> None:
    spec.compiler.degree = True
    spec.option.timestep = options.timestep
    spec.option.solver = _SOLVERS[options.solver]
    spec.option.integrator = _INTEGRATORS[options.integrator]
    spec.option.iterations = scene["iterations"]


def _add_arena(spec: mujoco.MjSpec, geoms: list[dict[str, Any]]) -> None:
    for geom in geoms:
        invisible_to_physics = geom.get("contype") == 0
        rgba = [1.0, 1.0, 1.0, 0.3] if invisible_to_physics else _GROUND
        add_geom(spec.worldbody, geom, {}, "", rgba)
    spec.worldbody.add_light(pos=[0, 0, 8], dir=[0, 0, -1])


def _add_sensors(spec: mujoco.MjSpec, touch: tuple[str, str] | None) -> None:
    # an accelerometer makes the engine compute cfrc_ext in RK4's first stage, as MuJoCo 1.31 did always
    spec.add_sensor(
        name="keep_contact_forces",
        type=mujoco.mjtSensor.mjSENS_ACCELEROMETER,
        objtype=mujoco.mjtObj.mjOBJ_SITE,
        objname="agent0/root",
    )
    if touch is None:
        return
    found, dist = mujoco.mjtConDataField.mjCONDATA_FOUND, mujoco.mjtConDataField.mjCONDATA_DIST
    spec.add_sensor(
        name=TOUCH,
        type=mujoco.mjtSensor.mjSENS_CONTACT,
        objtype=mujoco.mjtObj.mjOBJ_XBODY,  # with everything that hangs on it
        objname=touch[0],
        reftype=mujoco.mjtObj.mjOBJ_XBODY,
        refname=touch[1],
        intprm=[1 << int(found) | 1 << int(dist), 1, 1],  # fields; reduce: nearest; one contact
    )
