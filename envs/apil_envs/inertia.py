"""Mass and inertia of a body from its geoms, by today's capsules or by those of MuJoCo 1.31.

The pretrained agents were trained with capsules of the mass of a solid cylinder of the same radius and of
height L + r, L being the distance between the cap centres.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from apil_core import ConfigError
from apil_envs.arrays import Array


@dataclass(frozen=True)
class Inertial:
    """A rigid body's inertial.

    Attributes:
        mass: kg.
        centre: centre of mass in the body frame, (3,), m.
        tensor: inertia about the centre, axes of the body frame, (3, 3), kg m².
    """

    mass: float
    centre: Array
    tensor: Array

    @property
    def full(self) -> list[float]:
        """The tensor in MuJoCo's order: xx, yy, zz, xy, xz, yz."""
        t = self.tensor
        return [t[0, 0], t[1, 1], t[2, 2], t[0, 1], t[0, 2], t[1, 2]]


def sphere(centre: Array, radius: float, density: float) -> Inertial:
    """A solid ball."""
    mass = density * 4 / 3 * math.pi * radius**3
    return Inertial(mass, centre, 0.4 * mass * radius**2 * np.eye(3))


def capsule(start: Array, end: Array, radius: float, density: float) -> Inertial:
    """A capsule between two cap centres, with the mass of MuJoCo 1.31 (see above)."""
    length = float(np.linalg.norm(end - start))
    height = length + radius
    mass = density * math.pi * radius**2 * height
    along = mass * radius**2 / 2
    across = mass * (3 * radius**2 + height**2) / 12
    axis = (end - start) / length
    tensor = across * np.eye(3) + (along - across) * np.outer(axis, axis)
    return Inertial(mass, (start + end) / 2, tensor)


def combine(parts: Iterable[Inertial]) -> Inertial:
    """Join rigid parts into one (parallel axes)."""
    parts = list(parts)
    mass = sum(part.mass for part in parts)
    centre = sum((part.mass * part.centre for part in parts), np.zeros(3)) / mass
    tensor = np.zeros((3, 3))
    for part in parts:
        arm = part.centre - centre
        tensor += part.tensor + part.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return Inertial(mass, centre, tensor)


def legacy_inertial(geoms: list[dict[str, Any]], density: float) -> Inertial:
    """Inertial of a body with these geoms (``bodies.json``), by the rule of MuJoCo 1.31.

    Raises:
        ConfigError: a geom is neither sphere nor capsule.
    """
    parts = []
    for geom in geoms:
        radius = float(np.ravel(geom["size"])[0])
        if geom["type"] == "sphere":
            parts.append(sphere(np.array(geom["pos"], float), radius, density))
        elif geom["type"] == "capsule":
            ends = np.array(geom["fromto"], float).reshape(2, 3)
            parts.append(capsule(ends[0], ends[1], radius, density))
        else:
            raise ConfigError(
                f"no legacy inertia for geom {geom.get('name', '?')!r} of type {geom['type']!r}"
            )
    return combine(parts)
