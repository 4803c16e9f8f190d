"""A game's MuJoCo model: two robots, the arena, and the sensors the rules read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco

from apil_envs.bodies import add_body, add_geom, add_robot, description
from apil_envs.leapfrog import tune
from apil_envs.looks import dress
from apil_envs.options import PhysicsOptions

TOUCH = "touch"
"""Name of the contact sensor: (contacts found, smallest distance in m)."""

FLOOR = {
    "name": "floor",
    "type": "plane",
    "pos": [0, 0, 0],
    "size": [20, 20, 0.125],
    "condim": 3,
    "friction": [1, 0.1, 0.1],
}
"""The floor of the original scenes."""

_ITERATIONS = 1000  # of the constraint solver
_COLOURS = ([0.85, 0.3, 0.25, 1.0], [0.25, 0.4, 0.85, 1.0])
_GROUND = [0.8, 0.85, 0.8, 1.0]
_BALL = [0.95, 0.95, 0.9, 1.0]
_NO_DEFAULTS: dict[str, dict[str, Any]] = {"joint": {}, "geom": {}}  # the robots' defaults are theirs alone
_SOLVERS = {"PGS": mujoco.mjtSolver.mjSOL_PGS, "Newton": mujoco.mjtSolver.mjSOL_NEWTON}
_INTEGRATORS = {
    "RK4": mujoco.mjtIntegrator.mjINT_RK4,
    "Euler": mujoco.mjtIntegrator.mjINT_EULER,
    "implicitfast": mujoco.mjtIntegrator.mjINT_IMPLICITFAST,
    "leapfrog": mujoco.mjtIntegrator.mjINT_EULER,
}


@dataclass(frozen=True)
class Scene:
    """Robots, arena and balls of a game; elements are written as in ``bodies.json``.

    Attributes:
        body: ``"humanoid"`` or ``"ant"``, for both sides.
        agents: ``pos`` (m) and ``euler`` (degrees) of each side's root.
        geoms: the arena: keys as MuJoCo's geom attributes, ``type`` one of plane, sphere, capsule,
            cylinder, box. Missing keys have MuJoCo's defaults.
        ball: further free bodies.
    """

    body: str
    agents: Sequence[Mapping[str, Any]]
    geoms: Sequence[Mapping[str, Any]] = (FLOOR,)
    ball: Sequence[Mapping[str, Any]] = ()

    @classmethod
    def known(cls, name: str) -> Scene:
        """One of the six scenes of Bansal et al. 2018."""
        scene = description()["scenes"][name]
        return cls(scene["body"], scene["agents"], scene["geoms"], scene["ball"])


def build_scene(
    scene: Scene | str, options: PhysicsOptions, touch: tuple[str, str] | None = None
) -> mujoco.MjModel:
    """Compile the scene of a game.

    Args:
        scene: description, or the name of one of the six original scenes.
        options: the physics.
        touch: two bodies; a sensor named :data:`TOUCH` detects contacts between their subtrees.
    """
    scene = Scene.known(scene) if isinstance(scene, str) else scene
    spec = mujoco.MjSpec()
    _set_options(spec, options)
    _add_arena(spec, scene.geoms)
    balls = [add_body(spec.worldbody, dict(ball), _NO_DEFAULTS, "", "modern", _BALL) for ball in scene.ball]
    for side, pose in enumerate(scene.agents):
        add_robot(spec, scene.body, f"agent{side}/", dict(pose), options.inertia, _COLOURS[side])
    _keep_larger_margin(spec, balls, description()[scene.body]["defaults"]["geom"]["margin"])
    _add_sensors(spec, touch)
    model = spec.compile()
    if options.resolved.integrator == "leapfrog":
        tune(model)
    return model


def _set_options(spec: mujoco.MjSpec, options: PhysicsOptions) -> None:
    profile = options.resolved
    spec.compiler.degree = True
    spec.option.timestep = profile.timestep
    spec.option.solver = _SOLVERS[profile.solver]
    spec.option.integrator = _INTEGRATORS[profile.integrator]
    spec.option.iterations = _ITERATIONS


def _keep_larger_margin(spec: mujoco.MjSpec, balls: list[mujoco.MjsBody], margin: float) -> None:
    """Give every contact with a robot the robot's margin, and all others none.

    MuJoCo 1.31 took the larger of two geoms' margins, today's adds them. Only robots had one, so every geom
    gets half of it; contacts between arena and ball, which had none, are explicit pairs.
    """
    arena = [geom for geom in spec.worldbody.geoms if geom.contype]
    for geom in spec.geoms:
        geom.margin = margin / 2
    for ball in (geom for body in balls for geom in body.geoms):
        for geom in arena:
            slide = max(ball.friction[0], geom.friction[0])
            friction = [slide, slide, 0, 0, 0]  # condim 3: the other three are not used
            spec.add_pair(geomname1=geom.name, geomname2=ball.name, condim=3, friction=friction)


def _add_arena(spec: mujoco.MjSpec, geoms: Sequence[Mapping[str, Any]]) -> None:
    for number, geom in enumerate(geoms):
        invisible_to_physics = geom.get("contype") == 0
        rgba = [1.0, 1.0, 1.0, 0.3] if invisible_to_physics else _GROUND
        add_geom(spec.worldbody, {"name": f"arena{number}", **geom}, {}, "", rgba)
    dress(spec)


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
        objtype=mujoco.mjtObj.mjOBJ_XBODY,  # with its subtree
        objname=touch[0],
        reftype=mujoco.mjtObj.mjOBJ_XBODY,
        refname=touch[1],
        intprm=[1 << int(found) | 1 << int(dist), 1, 1],  # fields; reduce: nearest; one contact
    )
