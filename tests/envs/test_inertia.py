"""Masses and inertias of MuJoCo 1.31's capsules, against hand arithmetic and the zoo's own records."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from apil_core import ConfigError
from apil_envs.inertia import Inertial, capsule, combine, legacy_inertial, sphere
from apil_envs.options import PhysicsOptions
from apil_envs.scene import build_scene

from .zoo_reference import ReferenceLSTM, load_flat

MASSES = {"torso": 8.322, "right_thigh": 4.526, "left_thigh": 4.526}


def test_capsule_is_a_cylinder_of_height_length_plus_radius() -> None:
    part = capsule(np.array([0, -0.07, 0]), np.array([0, 0.07, 0]), 0.07, 1000)
    mass = 1000 * math.pi * 0.07**2 * 0.21
    assert part.mass == pytest.approx(mass)
    across = mass * (3 * 0.07**2 + 0.21**2) / 12
    np.testing.assert_allclose(np.diag(part.tensor), [across, mass * 0.07**2 / 2, across])
    np.testing.assert_array_equal(part.centre, 0)


def test_two_points_make_a_dumbbell() -> None:
    point = [Inertial(1.0, np.array([x, 0.0, 0.0]), np.zeros((3, 3))) for x in (0.0, 2.0)]
    joined = combine(point)
    assert joined.mass == 2
    np.testing.assert_allclose(joined.centre, [1, 0, 0])
    np.testing.assert_allclose(joined.tensor, np.diag([0, 2, 2]))


def test_sphere() -> None:
    ball = sphere(np.zeros(3), 0.5, 6 / math.pi)
    assert ball.mass == pytest.approx(1)
    np.testing.assert_allclose(ball.tensor, 0.1 * np.eye(3))


def test_unknown_geom_is_named() -> None:
    with pytest.raises(ConfigError, match="'slab' of type 'box'"):
        legacy_inertial([{"type": "box", "name": "slab", "size": 1}], 1000)


def test_humanoid_weighs_what_it_did() -> None:
    model = build_scene("kick-and-defend", PhysicsOptions())
    for side in (0, 1):
        for name, mass in MASSES.items():
            assert model.body(f"agent{side}/{name}").mass[0] == pytest.approx(mass, abs=5e-4)
        assert model.body(f"agent{side}/torso").subtreemass[0] == pytest.approx(39.65, abs=5e-3)
    assert model.body("ball").mass[0] == pytest.approx(0.1)


def test_modern_capsules_are_heavier() -> None:
    legacy, modern = (
        build_scene("kick-and-defend", PhysicsOptions(inertia=rule)) for rule in ("legacy", "modern")
    )
    shin = [model.body("agent0/right_shin").mass[0] for model in (legacy, modern)]
    cap_difference = 1000 * math.pi * 0.049**2 * (4 / 3 * 0.049 - 0.049)
    assert shin[1] - shin[0] == pytest.approx(cap_difference)


def test_zoo_remembers_these_masses(zoo_dir: Path) -> None:
    """The tenth number of every body's ``cinert`` is its mass, constant over all of the zoo's training."""
    model = build_scene("kick-and-defend", PhysicsOptions())
    flat = load_flat(zoo_dir / "kick-and-defend/kicker/agent1_parameters-v1.pkl")
    remembered = ReferenceLSTM(flat, 384, 17).obs_mean[45:175].reshape(13, 10)[:, 9]
    bodies = [b for b in range(model.nbody) if model.body(b).name.startswith("agent0/")]
    np.testing.assert_allclose(model.body_mass[bodies], remembered, rtol=2e-3)
