"""Toy-pursuit: its rules by hand, its victim, and whether it is the easy prey it is meant to be."""

from __future__ import annotations

import time

import numpy as np
import pytest
import torch

from apil_core import NO_WINNER, GameStep, UnknownNameError, View
from apil_envs.scripted import ToyEvader, list_scripted, load_scripted
from apil_envs.toy import CAUSES, EVADER, PURSUER, ToyPursuit, ToyPursuitOptions


def placed(evader: tuple[float, float], pursuer: tuple[float, float], max_steps: int = 50) -> ToyPursuit:
    game = ToyPursuit(1, options=ToyPursuitOptions(max_steps=max_steps))
    game.reset()
    game._position[:, 0] = [evader, pursuer]
    return game


def stay(game: ToyPursuit) -> GameStep:
    still = np.zeros((game.num_envs, 2), np.float32)
    return game.step((still, still))


@pytest.mark.parametrize(
    ("evader", "pursuer", "max_steps", "cause", "winner", "sparse"),
    [
        ((0, 0), (0.05, 0), 50, "caught", PURSUER, (-1000, 1500)),
        ((0.9, 0), (-0.5, 0), 50, "escaped", EVADER, (1000, -1000)),
        ((0.9, 0), (0.85, 0), 50, "caught", PURSUER, (-1000, 1500)),
        ((0, 0), (0.5, 0), 1, "time-up", NO_WINNER, (-1000, -1000)),
        ((0, 0), (0.5, 0), 50, None, NO_WINNER, (0, 0)),
    ],
)
def test_endings(evader, pursuer, max_steps, cause, winner, sparse) -> None:
    step = stay(placed(evader, pursuer, max_steps))
    assert (CAUSES[step.cause[0]] if step.done[0] else None) == cause
    assert step.winner[0] == winner
    np.testing.assert_array_equal(step.sparse[:, 0], sparse)
    distance = np.hypot(evader[0] - pursuer[0], evader[1] - pursuer[1])
    np.testing.assert_allclose(step.dense[:, 0], [distance, -distance], rtol=1e-6)


@pytest.mark.parametrize(("steps", "prize"), [(20, 1500), (21, 1000)])
def test_the_bonus_is_for_quick_catches(steps: int, prize: float) -> None:
    game = placed((0, 0), (0.5, 0))
    for _ in range(steps - 1):
        assert not stay(game).done[0]
    game._position[PURSUER, 0] = [0.05, 0]
    np.testing.assert_array_equal(stay(game).sparse[:, 0], [-1000, prize])


def test_observation_by_hand() -> None:
    game = placed((-0.5, 0.2), (0.1, -0.3))
    stay(game)
    evader, pursuer = (o[0] for o in game.observations)
    np.testing.assert_allclose(evader, [-0.5, 0.2, 0.6, -0.5, 1.45, -0.2, 0.98], rtol=1e-6)
    np.testing.assert_allclose(pursuer, [0.1, -0.3, -0.6, 0.5, 0.85, 0.3, 0.98], rtol=1e-6)


def test_nobody_leaves_the_disc() -> None:
    game = ToyPursuit(32)
    game.reset()
    out = np.full((32, 2), 5, np.float32)
    for _ in range(45):
        game.step((-out, out))
    assert np.linalg.norm(game._position, axis=2).max() <= 1 + 1e-12


def win_rates(pursuer, games: int = 256, steps: int = 300) -> np.ndarray:
    """Shares of (caught, escaped, time-up) over complete games against the scripted evader."""
    game, victim = ToyPursuit(games), ToyEvader()
    game.seed(0)
    game.reset()
    generator = torch.Generator().manual_seed(0)
    counts = np.zeros(3)
    first = torch.zeros(games, dtype=torch.bool)
    for _ in range(steps):
        evader, own = game.observations
        view = View(torch.from_numpy(evader), torch.from_numpy(own), first)
        action = victim.act(view, sample=True, generator=generator).action.numpy()
        step = game.step((action, pursuer(own)))
        counts += np.bincount(step.cause[step.done], minlength=3)
        game.reset(step.done)
    return counts / counts.sum()


def test_a_random_pursuer_loses_and_a_chaser_wins() -> None:
    rng = np.random.default_rng(0)
    assert win_rates(lambda own: rng.standard_normal((len(own), 2)))[0] < 0.15
    assert win_rates(lambda own: own[:, 2:4] * 20)[0] > 0.9


def test_the_evader_is_a_fixed_gaussian_with_a_habit() -> None:
    victim = load_scripted("toy-pursuit/evader/v1")
    assert victim.info.name == "scripted:toy-pursuit/evader/v1"
    assert len(victim.info.sha256) == 64
    observation = torch.tensor([[-0.5, 0.0, 0.2, 0.0, 1.45, 0.0, 1.0]])
    view = View(observation, observation, torch.zeros(1, dtype=torch.bool))
    decision = victim.act(view, sample=False, activations=True)
    assert decision.distribution is not None
    torch.testing.assert_close(decision.action, decision.distribution.mean)
    assert decision.action[0, 1] > 0.3, "pursuer straight ahead: it swerves to its left, always"
    draws = [
        victim.act(view, sample=True, generator=torch.Generator().manual_seed(s)).action for s in (1, 1, 2)
    ]
    torch.testing.assert_close(draws[0], draws[1])
    assert (draws[0] != draws[2]).all()


def test_unknown_script() -> None:
    with pytest.raises(UnknownNameError, match="did you mean 'toy-pursuit/evader/v1'"):
        load_scripted("toy-pursuit/evader/v2")
    assert [row.name for row in list_scripted()] == ["scripted:toy-pursuit/evader/v1"]


def test_it_is_fast() -> None:
    """A third of what it reaches on one free core, so that a busy machine does not fail it."""
    game = ToyPursuit(256)
    game.reset()
    still = np.zeros((256, 2), np.float32)
    start = time.perf_counter()
    for _ in range(200):
        game.step((still, still))
    assert 200 * 256 / (time.perf_counter() - start) > 100_000
