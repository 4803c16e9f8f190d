"""What the compiled scenes have in common, against docs/games.md, "Physics that must be kept"."""

from __future__ import annotations

import itertools

import mujoco
import numpy as np
import pytest

from apil_envs.bodies import description
from apil_envs.options import PhysicsOptions
from apil_envs.scene import FLOOR, Scene, build_scene

SCENES = sorted(description()["scenes"])
MARGIN = {"humanoid": 0.001, "ant": 0.01}


@pytest.mark.parametrize("name", SCENES)
def test_every_contact_has_the_larger_of_two_margins_as_in_mujoco_131(name: str) -> None:
    model = build_scene(name, PhysicsOptions())
    margin = MARGIN[description()["scenes"][name]["body"]]
    written_out = {frozenset(pair) for pair in zip(model.pair_geom1, model.pair_geom2, strict=True)}
    robots = [g for g in range(model.ngeom) if model.geom(g).name.startswith("agent")]
    for one, other in itertools.combinations(range(model.ngeom), 2):
        if one in robots or other in robots:
            assert frozenset((one, other)) not in written_out
            assert model.geom_margin[[one, other]].sum() == pytest.approx(margin)
    ball = [g for g in range(model.ngeom) if model.geom(g).name == "ball"]
    arena = [g for g in range(model.ngeom) if model.geom_bodyid[g] == 0 and model.geom_contype[g]]
    assert written_out == {frozenset((b, a)) for b in ball for a in arena}
    assert (model.pair_margin == 0).all()
    assert (model.pair_dim == 3).all()
    assert (model.pair_friction[:, :2] == 1).all()


def test_the_ball_rests_on_the_floor_itself() -> None:
    """Not on a margin above it; and both kinds of contact with it are found."""
    model = build_scene("kick-and-defend", PhysicsOptions())
    data = mujoco.MjData(model)
    ball = model.joint("ball").qposadr[0]
    data.qpos[ball : ball + 3] = 0, 5, 0.15 + 0.0005
    mujoco.mj_forward(model, data)
    assert not data.contact
    data.qpos[ball + 2] = 0.15 - 0.0005
    mujoco.mj_forward(model, data)
    (contact,) = data.contact
    assert contact.dim == 3
    assert contact.dist == pytest.approx(-0.0005)


@pytest.mark.parametrize("name", ["sumo-humans", "sumo-ants"])
def test_the_ring_is_compiled_with_its_largest_radius(name: str) -> None:
    from apil_core import make_game

    game = make_game(name, num_envs=64)
    game.seed(0)
    game.reset()
    compiled = build_scene(name, PhysicsOptions()).geom("arena").size[0]
    assert game.radius.max() <= compiled  # type: ignore[attr-defined]
    assert np.ptp(game.radius) > 1  # type: ignore[attr-defined]


@pytest.mark.parametrize("name", SCENES)
def test_both_robots_are_built_alike(name: str) -> None:
    model = build_scene(name, PhysicsOptions())
    halves = [
        [b for b in range(model.nbody) if model.body(b).name.startswith(f"agent{side}/")] for side in (0, 1)
    ]
    assert len(halves[0]) == len(halves[1]) == 13
    for field in ("body_mass", "body_inertia", "body_ipos"):
        values = getattr(model, field)
        np.testing.assert_array_equal(values[halves[0]], values[halves[1]])


def test_a_scene_of_ones_own() -> None:
    poses = [{"pos": [-2, 0, 0.75]}, {"pos": [2, 0, 0.75], "euler": [0, 0, 180]}]
    wall = {"type": "box", "pos": [0, 0, 0.5], "size": [0.1, 1, 0.5]}
    model = build_scene(Scene("ant", poses, geoms=[FLOOR, wall]), PhysicsOptions())
    assert model.geom("arena1").type == mujoco.mjtGeom.mjGEOM_BOX
    np.testing.assert_array_equal(model.body("agent1/torso").pos, [2, 0, 0.75])
