"""Leapfrog: its parts against hand arithmetic, and a whole control step against a fine reference."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from apil_core import ConfigError, make_game
from apil_envs.game_base import MujocoGame
from apil_envs.leapfrog import Shift, matched, tune, turned


def test_a_free_spring_goes_where_the_exact_solution_goes():
    step, largest, constant = 0.003, 0.95, 0.02
    slower, ratio = matched(np.array([[constant, 1.0]]), np.array([largest]), step)[0]
    damping, stiffness = 2 / (largest * slower), 1 / (largest * slower * ratio) ** 2  # MuJoCo's documentation
    # v' = v - h (b v + k x), x' = x + h v' has both eigenvalues at exp(-ωh), ω = 1 / (d τ)
    matrix = np.array(
        [[1 - step * damping, -step * stiffness], [step - step**2 * damping, 1 - step**2 * stiffness]]
    )
    decay = np.exp(-step / (largest * constant))
    assert np.trace(matrix) == pytest.approx(2 * decay, rel=1e-12)
    assert np.linalg.det(matrix) == pytest.approx(decay**2, rel=1e-12)


def test_a_tiny_step_leaves_contacts_as_they_are():
    np.testing.assert_allclose(
        matched(np.array([[0.02, 1.0]]), np.array([0.95]), 1e-7), [[0.02, 1.0]], rtol=1e-5
    )


@pytest.mark.parametrize("reference", [[0.02, 0.5], [-1000.0, -10.0]])
def test_other_contacts_are_refused(reference):
    with pytest.raises(ConfigError, match="critically damped"):
        matched(np.array([reference]), np.array([0.95]), 0.003)


def test_a_quarter_turn_about_the_own_z_axis():
    half = np.sqrt(0.5)
    turned_once = turned(np.array([[1.0, 0, 0, 0], [half, half, 0, 0]]), np.array([[0, 0, np.pi / 2]] * 2))
    # (√½ + √½ i)(√½ + √½ k) = ½ + ½ i + ½ k + ½ ik, and ik = -j
    np.testing.assert_allclose(turned_once, [[half, 0, 0, half], [0.5, 0.5, -0.5, 0.5]], atol=1e-15)
    np.testing.assert_array_equal(turned(np.array([[0.6, 0, 0.8, 0]]), np.zeros((1, 3))), [[0.6, 0, 0.8, 0]])


def test_shift_is_what_mujoco_calls_integrating_the_position():
    game = game_of("kick-and-defend", physics="fast")
    model, rng = game.physics.model, np.random.default_rng(0)
    qvel = rng.normal(0, 3, (4, model.nv))
    source = game.physics.qpos.copy()
    shifted = np.zeros_like(source)
    Shift(model)(source, shifted, qvel, slice(None), 0.01)
    for row in range(4):
        mujoco.mj_integratePos(model, source[row], qvel[row], 0.01)
    np.testing.assert_allclose(shifted, source, atol=1e-12)


def test_joint_damping_by_the_midpoint_rule():
    text = """<mujoco><option timestep="0.01" gravity="0 0 0"/><worldbody><body>
        <joint name="j" type="slide" damping="3" armature="0.5"/><geom size="0.1" mass="1.5" contype="0"/>
        </body></worldbody></mujoco>"""
    model = mujoco.MjModel.from_xml_string(text)
    tune(model)
    data = mujoco.MjData(model)
    data.qvel[0] = 1.0
    mujoco.mj_step(model, data)
    # M = 2, D = 3, h = .01: v' = v (M - hD/2) / (M + hD/2)
    assert data.qvel[0] == pytest.approx(1.985 / 2.015, rel=1e-12)


def game_of(name: str, num_envs: int = 4, **options) -> MujocoGame:
    game = make_game(name, num_envs=num_envs, threads=1, options=options)
    assert isinstance(game, MujocoGame)
    game.seed(3)
    game.reset()
    return game


def after(name: str, steps: int, **options) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities of 32 games after some steps of equal random actions."""
    game, rng = game_of(name, 32, **options), np.random.default_rng(1)
    size, high = game.layout.sides[0].action_size, game.layout.sides[0].action_high
    for _ in range(steps):
        first, second = rng.uniform(-high, high, (2, 32, size)).astype(np.float32)
        game.step((first, second))
    return game.physics.qpos.copy(), game.physics.qvel.copy()


@pytest.mark.parametrize("name", ["kick-and-defend", "sumo-ants"])
def test_it_follows_a_fine_reference_more_closely_than_euler(name):
    reference = after(name, 3, integrator="RK4", solver="Newton", timestep=0.0005, substeps=30)
    errors = {}
    for integrator in ("Euler", "leapfrog"):
        values = after(name, 3, integrator=integrator, solver="Newton")
        errors[integrator] = [np.median(np.abs(a - b)) for a, b in zip(values, reference, strict=True)]
    assert errors["leapfrog"][0] < 0.4 * errors["Euler"][0]
    assert errors["leapfrog"][1] < 0.4 * errors["Euler"][1]


def test_a_game_goes_on_bit_for_bit_from_its_state():
    game, other = game_of("sumo-humans", physics="fast"), game_of("sumo-humans", physics="fast")
    rng = np.random.default_rng(0)
    actions = rng.normal(0, 0.4, (8, 2, 4, 17)).astype(np.float32)
    for first, second in actions[:4]:
        game.step((first, second))
    other.load_state_dict(game.state_dict())
    for first, second in actions[4:]:
        game.step((first, second))
        other.step((first, second))
    np.testing.assert_array_equal(game.physics.qpos, other.physics.qpos)
    for mine, theirs in zip(game.observations, other.observations, strict=True):
        np.testing.assert_array_equal(mine, theirs)
