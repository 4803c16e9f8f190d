"""Sky, floor and light of a scene, without influence on the physics."""

from __future__ import annotations

import mujoco

FLOOR = "floor"
"""Name of the material planes are covered with."""

GOAL = "goal"
"""Name of a goal's crossbar, if there is a goal."""

_SKY, _HORIZON = [0.45, 0.62, 0.82], [0.93, 0.95, 0.97]
_TILES = [0.80, 0.83, 0.80], [0.73, 0.77, 0.74]
_TILE = 1.0  # side of a floor tile, m


_RING, _LINE = [0.86, 0.79, 0.66, 1.0], [0.35, 0.39, 0.43, 1.0]
_THICK = 0.1  # radius above which a cylinder is a ring rather than a line, m
_POST = 0.05  # half thickness of a goal's posts, m
_GOAL = [0.97, 0.97, 0.97, 1.0]


def dress(spec: mujoco.MjSpec) -> None:
    """Add sky, light, colours and goal posts to a scene; its arena must be there already."""
    _add_sky(spec)
    _add_floor(spec)
    _add_light(spec)
    for geom in spec.worldbody.geoms:
        if geom.type == mujoco.mjtGeom.mjGEOM_CYLINDER:
            geom.rgba = _RING if geom.size[0] > _THICK else _LINE
        elif geom.type == mujoco.mjtGeom.mjGEOM_BOX and geom.contype == 0:
            _make_goal(spec, geom)


def _add_sky(spec: mujoco.MjSpec) -> None:
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=_SKY,
        rgb2=_HORIZON,
        width=128,
        height=128 * 6,
    )
    spec.visual.rgba.haze = [*_HORIZON, 1]


def _add_floor(spec: mujoco.MjSpec) -> None:
    spec.add_texture(
        name=FLOOR,
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER,
        rgb1=_TILES[0],
        rgb2=_TILES[1],
        width=128,
        height=128,
    )
    material = spec.add_material(name=FLOOR, texuniform=True, texrepeat=[1 / (2 * _TILE)] * 2, specular=0)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = FLOOR
    for geom in spec.worldbody.geoms:
        if geom.type == mujoco.mjtGeom.mjGEOM_PLANE:
            geom.material, geom.rgba = FLOOR, [1, 1, 1, 1]


def _add_light(spec: mujoco.MjSpec) -> None:
    spec.visual.headlight.ambient = [0.42, 0.42, 0.42]
    spec.visual.headlight.diffuse = [0.22, 0.22, 0.22]
    spec.visual.headlight.specular = [0, 0, 0]
    spec.worldbody.add_light(
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        pos=[-4.2, -5.4, 12],
        dir=[0.35, 0.45, -1],
        diffuse=[0.55, 0.55, 0.55],
        specular=[0.15, 0.15, 0.15],
        castshadow=True,
    )


def _make_goal(spec: mujoco.MjSpec, wall: mujoco.MjsGeom) -> None:
    """Draw a goal instead of a wall without contacts (which would cast a wall's shadow)."""
    wall.rgba = [0, 0, 0, 0]
    x, y = wall.pos[:2]
    width, height = wall.size[1], wall.size[2]
    box = mujoco.mjtGeom.mjGEOM_BOX
    spec.worldbody.add_site(
        name=GOAL, type=box, pos=(x, y, height), size=(_POST, width + _POST, _POST), rgba=_GOAL
    )
    for way in (-1, 1):
        post = (x, y + way * width, height / 2)
        spec.worldbody.add_site(type=box, pos=post, size=(_POST, _POST, height / 2), rgba=_GOAL)
