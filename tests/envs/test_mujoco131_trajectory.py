"""Sumo-ants against two episodes of the original engine, MuJoCo 1.31: the only ground truth there is.

The recording shows what one side saw and did (float32), and what it was paid. Every recorded state is put
into a simulation of our game, one step is played with the recorded action, and the outcome is compared with
what was recorded next. Of the opponent only the positions are known: its velocity is taken from their
differences and its action as none, so what happens in a fight is predicted less well.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import mujoco
import numpy as np
import pytest

from apil_core import GameStep
from apil_core.plugins.registry import make_game
from apil_envs.sumo import CAUSES, SumoAnts

FILE = "sumo_ants_mujoco131_trajectory.npz"
OWN, OWN_VELOCITY, CONTACT = slice(0, 15), slice(15, 29), slice(29, 107)
OTHER, RELATIVE, ROTATION = slice(107, 122), slice(122, 124), slice(124, 133)
RADIUS, OWN_EDGE, OTHER_EDGE, TIME_LEFT = range(133, 137)
SECONDS = 0.015


@dataclass
class Predicted:
    """One episode, every step of it predicted from the recorded state before.

    Attributes:
        seen, actions, rewards: as recorded, (T, 137), (T, 8), (T,).
        game: T simulations, one step after the recorded states.
        step: what that step gave.
    """

    seen: np.ndarray
    actions: np.ndarray
    rewards: np.ndarray
    game: SumoAnts
    step: GameStep

    def error(self, ours: np.ndarray, part: slice) -> np.ndarray:
        """Largest error of each prediction, (T - 1,); the last state was not recorded."""
        return np.abs(ours[:-1] - self.seen[1:, part]).max(1)

    @cached_property
    def velocity_error(self) -> np.ndarray:
        """Of the own velocities, m/s and rad/s."""
        return self.error(self.game.robots[0].qvel, OWN_VELOCITY)

    @cached_property
    def contact_error(self) -> np.ndarray:
        """Of the own contact forces, clipped to ±1."""
        return self.error(self.game.robots[0].contact_force.clip(-1, 1), CONTACT)

    @cached_property
    def reward_error(self) -> np.ndarray:
        """(T,)."""
        return np.abs(self.step.dense[0] + self.step.sparse[0] - self.rewards)

    @cached_property
    def touching(self) -> tuple[np.ndarray, np.ndarray]:
        """The own ant in contact with the arena, or with the other, before or after a step, (T - 1,)."""
        model = self.game.physics._batch.get_model(0)
        data = mujoco.MjData(model)
        pairs = np.array([self._pairs(model, data, row) for row in self.seen])
        arena, other = (pairs[:-1] | pairs[1:]).T
        # something came and went in between
        force = self.game.robots[0].contact_force[:-1].any(1) | self.seen[1:, CONTACT].any(1)
        return arena | force & ~other, other

    @staticmethod
    def _pairs(model: mujoco.MjModel, data: mujoco.MjData, row: np.ndarray) -> tuple[bool, bool]:
        model.geom("arena").size[0] = row[RADIUS]
        data.qpos[:] = np.concatenate([row[OWN], row[OTHER]])
        mujoco.mj_forward(model, data)
        bodies = [sorted(model.geom_bodyid[contact.geom]) for contact in data.contact]
        return any(a == 0 < b <= 13 for a, b in bodies), any(0 < a <= 13 < b for a, b in bodies)


def velocities(model: mujoco.MjModel, positions: np.ndarray) -> np.ndarray:
    """Central differences of the second ant's positions, (T, 15) to (T, 14)."""
    whole = np.tile(model.qpos0, (len(positions), 1))
    whole[:, 15:] = positions
    result = np.zeros((len(positions), model.nv))
    for t in range(len(positions)):
        first, last = max(t - 1, 0), min(t + 1, len(positions) - 1)
        mujoco.mj_differentiatePos(model, result[t], SECONDS * (last - first), whole[first], whole[last])
    return result[:, 14:]


def predict(
    recording: dict[str, np.ndarray],
    episode: int,
    margins: tuple[float, float] | None = None,
    **options: str,
) -> Predicted:
    """``margins`` of robots and arena (m), if not those of the game; ``options`` of the game."""
    seen, actions, rewards = (recording[f"{key}_{episode}"] for key in ("observations", "actions", "rewards"))
    game = make_game("sumo-ants", num_envs=len(seen), options=options)
    assert isinstance(game, SumoAnts)
    game.seed(0)
    game.reset()
    if margins is not None:
        bodies, geoms = (game.physics.expand(f"{kind}_margin") for kind in ("body", "geom"))
        geoms[:] = np.where(game.physics.model.geom_bodyid > 0, *margins)
        bodies[:] = np.where(np.arange(bodies.shape[1]) > 0, *margins)
    own, other = game.robots
    game.radius[:] = seen[:, RADIUS]
    own.qpos[:], own.qvel[:], other.qpos[:] = seen[:, OWN], seen[:, OWN_VELOCITY], seen[:, OTHER]
    other.qvel[:] = velocities(game.physics.model, seen[:, OTHER])
    game.clock[:] = np.arange(len(seen))
    game.touched[:] = True
    game.physics.forward()
    step = game.step((actions.astype(np.float32), np.zeros_like(actions, np.float32)))
    return Predicted(seen, actions, rewards, game, step)


@pytest.fixture(scope="module")
def recording() -> dict[str, np.ndarray]:
    """``FILE`` in ``$APIL_DATA`` or ``<repository>/../shared/data``."""
    beside = Path(__file__).resolve().parents[3] / "shared" / "data"
    path = Path(os.environ.get("APIL_DATA", beside)) / FILE
    if not path.is_file():
        pytest.skip(f"no recording of MuJoCo 1.31 at {path} (set APIL_DATA to the folder of {FILE})")
    with np.load(path) as arrays:
        return dict(arrays)


@pytest.fixture(scope="module")
def both(recording: dict[str, np.ndarray]) -> list[Predicted]:
    return [predict(recording, episode) for episode in (0, 1)]


def pooled(both: list[Predicted], what: str, arena: bool, other: bool) -> np.ndarray:
    """An error over all steps with exactly these contacts."""
    return np.concatenate(
        [getattr(p, what)[(p.touching[0] == arena) & (p.touching[1] == other)] for p in both]
    )


def test_the_observation_is_what_the_description_says(recording: dict[str, np.ndarray]) -> None:
    for episode, steps in ((0, 127), (1, 210)):
        seen = recording[f"observations_{episode}"]
        assert seen.shape == (steps, 137)
        np.testing.assert_array_equal(seen[:, TIME_LEFT], 500 - np.arange(steps))
        np.testing.assert_array_equal(seen[:, RADIUS], seen[0, RADIUS])
        own, other, radius = seen[:, OWN], seen[:, OTHER], seen[:, RADIUS]
        np.testing.assert_allclose(seen[:, RELATIVE], other[:, :2] - own[:, :2], atol=2e-7)
        np.testing.assert_allclose(seen[:, OWN_EDGE], radius - np.hypot(*own[:, :2].T), atol=3e-7)
        np.testing.assert_allclose(seen[:, OTHER_EDGE], radius - np.hypot(*other[:, :2].T), atol=3e-7)
        assert np.abs(seen[:, CONTACT]).max() == 1
        assert not seen[0, CONTACT].any()


def test_the_recorded_starts_could_be_ours(recording: dict[str, np.ndarray]) -> None:
    pose = make_game("sumo-ants", num_envs=1).physics.model.qpos0.reshape(2, 15)
    for episode in (0, 1):
        first = recording[f"observations_{episode}"][0]
        radius, gap = first[RADIUS], 0.3 + 2.5 / 2
        assert 2.5 <= radius <= 4.5
        for side, part in enumerate((OWN, OTHER)):
            position = first[part]
            outward = (2 * side - 1) * position[0]
            assert 0.3 <= outward <= radius - gap
            assert abs(position[1]) <= np.sqrt(radius**2 - outward**2) - gap
            noise = position - pose[side]
            # the noisy quaternion was normalised
            assert np.abs(noise[[2, *range(7, 15)]]).max() <= 0.1
            assert np.abs(noise[3:7]).max() < 0.12
            assert np.linalg.norm(position[3:7]) == pytest.approx(1, abs=1e-6)
        assert 0.04 < first[OWN_VELOCITY].std() < 0.2


def test_our_observations_follow_the_same_convention(both: list[Predicted]) -> None:
    """All 137 numbers at once, where nothing touches; the opponent is known only roughly."""
    for p in both:
        free = ~p.touching[0] & ~p.touching[1]
        error = np.abs(p.game.observations[0][:-1] - p.seen[1:])[free]
        roughly = np.zeros(137, bool)
        roughly[[*range(107, 124), OTHER_EDGE]] = True
        assert np.quantile(error[:, ~roughly].max(1), 0.9) < 2e-6  # float32 of what runs up to 10
        assert np.quantile(error[:, [107, 108, 109, 122, 123, OTHER_EDGE]].max(1), 0.9) < 0.02


def test_without_contact_the_prediction_is_exact(both: list[Predicted]) -> None:
    """195 steps: median 4.8e-7, 90 % below 9.6e-7, worst 1.0e-4 (where a hinge hits its limit)."""
    errors = pooled(both, "velocity_error", arena=False, other=False)
    assert len(errors) == 195
    assert np.median(errors) < 6e-7
    assert np.quantile(errors, 0.9) < 1.2e-6
    assert errors.max() < 2e-4
    assert pooled(both, "contact_error", arena=False, other=False).max() == 0


def test_on_the_arena_the_prediction_is_close(both: list[Predicted]) -> None:
    """87 steps. Velocities: median 3.2e-3, 90 % below 3.4e-2, worst 1.0 (a leg lands 4 cm deep); clipped
    contact forces: median 5.2e-8, 54 % to the last digit of float32, 90 % below 6.1e-2. Capsule on cylinder
    is computed by another algorithm today."""
    errors = pooled(both, "velocity_error", arena=True, other=False)
    forces = pooled(both, "contact_error", arena=True, other=False)
    assert len(errors) == 87
    assert np.median(errors) < 4.5e-3
    assert np.quantile(errors, 0.9) < 5e-2
    assert errors.max() < 1.5
    assert np.median(forces) < 1e-7
    assert (forces < 1e-6).mean() > 0.5
    assert np.quantile(forces, 0.9) < 0.1


def test_in_a_fight_the_prediction_is_fair(both: list[Predicted]) -> None:
    """The two ants only: 22 steps, median 1.9e-2, worst 0.28; with the arena too: 31 steps, 6.3e-2, 0.93."""
    alone = pooled(both, "velocity_error", arena=False, other=True)
    with_arena = pooled(both, "velocity_error", arena=True, other=True)
    assert (len(alone), len(with_arena)) == (22, 31)
    assert np.median(alone) < 3e-2
    assert np.median(with_arena) < 8e-2
    assert max(alone.max(), with_arena.max()) < 1.2


def test_margins_do_not_add_up(recording: dict[str, np.ndarray], both: list[Predicted]) -> None:
    """MuJoCo 1.31 took the larger of two margins, ours adds them. Two ants must meet at 0.01 m: at 0.02 m the
    median error in a fight off the arena grows from 1.9e-2 to 1.1e-1 (contact forces: 1.9e-2 to 0.48)."""
    fights = [p.touching[1] & ~p.touching[0] for p in both]
    medians = []
    for margins in (None, (0.005, 0.005), (0.01, 0.0)):
        tried = [predict(recording, episode, margins) for episode in (0, 1)]
        errors = [
            np.concatenate([e[f] for e, f in zip(part, fights, strict=True)])
            for part in ([p.velocity_error for p in tried], [p.contact_error for p in tried])
        ]
        medians.append([np.median(e) for e in errors])
    ours, halves, added = medians
    assert ours == halves
    assert added[0] > 3 * ours[0]
    assert added[1] > 10 * ours[1]


def test_capsules_are_weighed_as_cylinders(recording: dict[str, np.ndarray], both: list[Predicted]) -> None:
    """With today's capsules the median error in free flight grows from 4.8e-7 to 8.5e-4."""
    modern = [predict(recording, episode, inertia="modern") for episode in (0, 1)]
    free = [~p.touching[0] & ~p.touching[1] for p in both]
    errors = np.concatenate([p.velocity_error[f] for p, f in zip(modern, free, strict=True)])
    assert np.median(errors) > 1e-4


def test_the_rotation_is_one_stage_behind(both: list[Predicted]) -> None:
    """The recorded torso matrix is not that of the recorded position, but the one the last stage left."""
    for p in both:
        free = ~p.touching[0] & ~p.touching[1]
        stale = p.error(p.game.robots[0].torso_rotation, ROTATION)[free]
        fresh = np.zeros((len(p.seen), 9))
        for matrix, position in zip(fresh, p.seen, strict=True):
            mujoco.mju_quat2Mat(matrix, position[3:7])
        late = np.abs(fresh - p.seen[:, ROTATION])[1:].max(1)[free]
        # 90 %: 7e-7 against 1.1e-5; worst 2e-5 against 2.9e-4
        assert np.quantile(stale, 0.9) < 1.5e-6 < 5e-6 < np.quantile(late, 0.9)


def test_rewards(both: list[Predicted]) -> None:
    """Exact in float32 without contact (control cost on unclipped actions, distance after the step); with
    contacts the cost of the predicted forces: median 2.9e-6 on the arena, 1.1e-4 in a fight, worst 0.13."""
    for p in both:
        touching = p.touching[0] | p.touching[1]
        assert p.reward_error[:-1][~touching].max() < 1e-6
        assert np.median(p.reward_error[:-1][touching]) < 1e-4
        assert p.reward_error[:-1].max() < 0.2
        assert (np.abs(p.actions) > 1).any(), "no action beyond the bounds"


def test_the_games_end_when_and_as_they_did(both: list[Predicted]) -> None:
    """One was won, one lost, by a fall; the dense part of the last reward is exact too, -5 for falling."""
    for p, winner, reward in zip(both, (0, 1), (1001.5917, -1008.1717), strict=True):
        assert np.flatnonzero(p.step.done).tolist() == [len(p.seen) - 1]
        assert p.game.touching[:-1].any(), "whoever wins must have touched the other"
        assert CAUSES[p.step.cause[-1]] == f"fighter_{1 - winner}-fell"
        assert p.step.winner[-1] == winner
        assert p.rewards[-1] == pytest.approx(reward, abs=1e-4)
        assert p.reward_error[-1] < 1e-6
