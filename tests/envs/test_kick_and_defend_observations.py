"""Observations and dense rewards against a plain MjData loop that spells every number out."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from apil_envs.kick_and_defend import KickAndDefend, KickAndDefendOptions
from apil_envs.scene import build_scene

STEPS = 25
GAMES = 3
ORDER = {
    "position": 22,
    "velocity": 23,
    "body_inertia": 130,
    "body_velocity": 78,
    "actuator_force": 23,
    "contact_force": 78,
    "opponent_xy": 2,
    "opponent_position": 22,
    "ball_xy": 2,
    "ball_height": 1,
    "goal_distance": 1,
    "left_post_distance": 1,
    "right_post_distance": 1,
}


def observe(model: mujoco.MjModel, data: mujoco.MjData, side: int) -> dict[str, np.ndarray]:
    """One side's blocks, one game, by name and index, with nothing shared with the package."""
    bodies = [b for b in range(model.nbody) if model.body(b).name.startswith(f"agent{side}/")]
    roots = [model.joint(f"agent{s}/root") for s in (side, 1 - side)]
    own, other = (data.qpos[r.qposadr[0] : r.qposadr[0] + 24] for r in roots)
    dofs = slice(roots[0].dofadr[0], roots[0].dofadr[0] + 23)
    ball = data.joint("ball").qpos[:3]
    return {
        "position": own[2:],
        "velocity": data.qvel[dofs],
        "body_inertia": np.concatenate([data.cinert[b] for b in bodies]),
        "body_velocity": np.concatenate([data.cvel[b] for b in bodies]),
        "actuator_force": data.qfrc_actuator[dofs],
        "contact_force": np.concatenate([data.cfrc_ext[b] for b in bodies]).clip(-1, 1),
        "opponent_xy": other[:2] - own[:2],
        "opponent_position": other[2:],
        "ball_xy": ball[:2] - own[:2],
        "ball_height": ball[2:],
        "goal_distance": np.array([4 - ball[0]]),
        "left_post_distance": np.array([3 - ball[1]]),
        "right_post_distance": np.array([-3 - ball[1]]),
    }


def centre_x(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    bodies = [b for b in range(model.nbody) if model.body(b).name.startswith("agent0/")]
    mass = model.body_mass[bodies]
    return float(mass @ data.xipos[bodies, 0] / mass.sum())


def dense(model: mujoco.MjModel, data: mujoco.MjData, moved: float) -> list[float]:
    """Dense rewards of kicker and keeper, spelt out from docs/games.md."""
    ball = data.joint("ball").qpos[:3]
    rewards = []
    for side in (0, 1):
        bodies = [b for b in range(model.nbody) if model.body(b).name.startswith(f"agent{side}/")]
        x, y, z = data.joint(f"agent{side}/root").qpos[:3]
        control = 0.1 * float(np.square(data.ctrl[17 * side : 17 * side + 17]).sum())
        contact = min(0.5e-6 * float(np.square(data.cfrc_ext[bodies]).sum()), 10)
        if side == 0:
            extra = 0.25 * moved / 0.003 - float(np.hypot(ball[0] - x, ball[1] - y))
            alive = z >= 1
        else:
            extra = 0.0
            alive = z >= 1 and x <= 4.05 and abs(y) <= 3
        rewards.append(extra - control - contact + (5 if alive else -5))
    return rewards


def test_blocks_tile_the_observation() -> None:
    game = KickAndDefend(1)
    for side in game.layout.sides:
        assert side.observation_size == 384
        assert {name: part.stop - part.start for name, part in side.blocks.items()} == ORDER
        assert list(side.blocks) == list(ORDER)
        edges = [0, *np.cumsum(list(ORDER.values()))]
        assert [part.start for part in side.blocks.values()] == edges[:-1]
        assert side.opponent_channels == tuple(range(354, 378))
        assert (side.action_size, side.action_low, side.action_high) == (17, -0.4, 0.4)


def test_the_game_is_a_plain_mujoco_loop() -> None:
    game = KickAndDefend(GAMES, threads=2)
    game.seed(3)
    game.reset()
    model = build_scene("kick-and-defend", KickAndDefendOptions(), touch=("agent1/torso", "ball"))
    loops = [mujoco.MjData(model) for _ in range(GAMES)]
    for i, data in enumerate(loops):
        mujoco.mj_setState(model, data, game.physics.state[i], mujoco.mjtState.mjSTATE_INTEGRATION)
        mujoco.mj_forward(model, data)
        mujoco.mj_setState(model, data, game.physics.state[i], mujoco.mjtState.mjSTATE_INTEGRATION)
    rng = np.random.default_rng(1)
    for _ in range(STEPS):
        for side in (0, 1):
            for i, data in enumerate(loops):
                expected = np.concatenate(list(observe(model, data, side).values()))
                np.testing.assert_array_equal(game.observations[side][i], expected.astype(np.float32))
        actions = [rng.normal(0, 0.4, (GAMES, 17)).astype(np.float32) for _ in (0, 1)]
        before = [centre_x(model, data) for data in loops]
        step = game.step((actions[0], actions[1]))
        assert not step.done.any()
        for i, data in enumerate(loops):
            data.ctrl[:] = np.concatenate([a[i] for a in actions]).clip(-0.4, 0.4)
            mujoco.mj_step(model, data, 5)
            expected_reward = dense(model, data, centre_x(model, data) - before[i])
            np.testing.assert_allclose(step.dense[:, i], expected_reward, rtol=1e-5, atol=1e-5)
    for side in (0, 1):
        contact = game.layout.sides[side].blocks["contact_force"]
        assert np.abs(game.observations[side][:, contact]).max() > 0, "the robots never touched the floor"


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast"])
def test_contact_forces_stay_alive_with_other_integrators(integrator: str) -> None:
    game = KickAndDefend(2, options=KickAndDefendOptions(integrator=integrator, solver="Newton"))
    game.seed(0)
    game.reset()
    still = np.zeros((2, 17), np.float32)
    for _ in range(30):
        game.step((still, still))
    contact = game.layout.sides[0].blocks["contact_force"]
    assert np.abs(game.observations[0][:, contact]).max() > 0
