"""The robots, built into a ``MjSpec`` from the numbers in ``data/bodies.json``."""

from __future__ import annotations

import functools
import json
from importlib import resources
from typing import Any

import mujoco
import numpy as np

from apil_envs.inertia import legacy_inertial
from apil_envs.options import InertiaRule

_GEOM_TYPES = {
    "plane": mujoco.mjtGeom.mjGEOM_PLANE,
    "sphere": mujoco.mjtGeom.mjGEOM_SPHERE,
    "capsule": mujoco.mjtGeom.mjGEOM_CAPSULE,
    "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER,
    "box": mujoco.mjtGeom.mjGEOM_BOX,
}
_JOINT_TYPES = {"free": mujoco.mjtJoint.mjJNT_FREE, "hinge": mujoco.mjtJoint.mjJNT_HINGE}
_DENSITY = 1000.0


@functools.cache
def description() -> dict[str, Any]:
    """The whole of ``bodies.json``: ``humanoid``, ``ant`` and ``scenes``. Do not modify."""
    return json.loads(resources.files("apil_envs").joinpath("data/bodies.json").read_text("utf-8"))


def add_geom(
    body: mujoco.MjsBody, geom: dict[str, Any], defaults: dict[str, Any], prefix: str, rgba: list[float]
) -> None:
    """Add one geom; keys it lacks come from ``defaults``."""
    values = {**defaults, **geom}
    size = np.zeros(3)
    given = np.ravel(values.pop("size"))
    size[: given.size] = given
    kind, name = _GEOM_TYPES[values.pop("type")], values.pop("name", None)
    if "friction" in values:
        values["friction"] = np.array(values["friction"], float)
    if "fromto" in values:
        values["fromto"] = np.array(values["fromto"], float)
    body.add_geom(name=prefix + name if name else None, type=kind, size=size, rgba=rgba, **values)


def add_joint(body: mujoco.MjsBody, joint: dict[str, Any], defaults: dict[str, Any], prefix: str) -> None:
    """Add one joint; keys it lacks come from ``defaults``."""
    values = {**defaults, **joint}
    limited = mujoco.mjtLimited.mjLIMITED_TRUE if values.pop("limited") else mujoco.mjtLimited.mjLIMITED_FALSE
    kind, name = _JOINT_TYPES[values.pop("type")], prefix + values.pop("name")
    body.add_joint(name=name, type=kind, limited=limited, **values)


def add_body(
    parent: mujoco.MjsBody,
    tree: dict[str, Any],
    defaults: dict[str, Any],
    prefix: str,
    inertia: InertiaRule,
    rgba: list[float],
) -> mujoco.MjsBody:
    """Add a body and all below it; returns it. ``legacy`` gives every body an explicit inertial."""
    frame = {key: tree[key] for key in ("pos", "quat", "euler") if key in tree}
    # the ant's feet are unnamed
    name = tree["name"] if tree["name"] != "unnamed" else parent.name.removeprefix(prefix) + "_end"
    body = parent.add_body(name=prefix + name, **frame)
    for joint in tree["joints"]:
        add_joint(body, joint, defaults["joint"], prefix)
    for geom in tree["geoms"]:
        add_geom(body, geom, defaults["geom"], prefix, rgba)
    if inertia == "legacy":
        inertial = legacy_inertial(tree["geoms"], defaults["geom"].get("density", _DENSITY))
        body.explicitinertial = True
        body.mass, body.ipos, body.fullinertia = inertial.mass, inertial.centre, inertial.full
    for child in tree["children"]:
        add_body(body, child, defaults, prefix, inertia, rgba)
    return body


def add_robot(
    spec: mujoco.MjSpec,
    kind: str,
    prefix: str,
    pose: dict[str, Any],
    inertia: InertiaRule,
    rgba: list[float],
) -> mujoco.MjsBody:
    """Add a whole robot with its motors.

    Args:
        spec: the scene.
        kind: ``"humanoid"`` or ``"ant"``.
        prefix: put before every name, e.g. ``"agent0/"``.
        pose: ``pos`` and ``euler`` (degrees) of its root.
        inertia: see :mod:`apil_envs.inertia`.
        rgba: its colour.

    Returns:
        its root body, which carries a site ``<prefix>root`` at its origin.
    """
    robot = description()[kind]
    root = add_body(spec.worldbody, {**robot["root"], **pose}, robot["defaults"], prefix, inertia, rgba)
    root.add_site(name=prefix + "root")
    for motor in robot["motors"]:
        values = {**robot["defaults"]["motor"], **motor}
        spec.add_actuator(
            name=prefix + motor.get("name", motor["joint"]),
            target=prefix + motor["joint"],
            trntype=mujoco.mjtTrn.mjTRN_JOINT,
            gear=[motor["gear"], 0, 0, 0, 0, 0],
            ctrllimited=mujoco.mjtLimited.mjLIMITED_TRUE,
            ctrlrange=values["ctrlrange"],
        )
    return root
