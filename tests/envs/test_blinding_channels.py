"""Blinding hides the columns about the opponent, all of them and no others, in every game."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest
import torch
from evaluation.spy import Spy, play_spied

from apil_core import Game, View
from apil_core.evaluation.play import Blinding
from apil_core.plugins.registry import default_plugins, make_game
from apil_envs.game_base import MujocoGame
from apil_envs.toy import ToyPursuit

HUMANOID = 24 + 23 + 13 * 10 + 13 * 6 + 23 + 13 * 6
"""Own position, velocity, inertia, velocity of bodies, motor forces, contact forces."""
ANT = 15 + 14 + 13 * 6

# Counted by hand from the tables of the original observations. After the own body come, in
# kick-and-defend (whose own position lacks x and y):
#   opponent's relative xy 2, its position without x and y 22; ball 3, goal 3
# sumo:
#   opponent's position 24 (ant 15), relative xy 2; own rotation 9, ring 1, own edge 1, ITS EDGE 1, time 1
# you-shall-not-pass, run-to-goal:
#   opponent's position
ABOUT_OPPONENT = {
    "kick-and-defend": {*range(HUMANOID - 2, HUMANOID - 2 + 2 + 22)},
    "you-shall-not-pass": {*range(HUMANOID, HUMANOID + 24)},
    "sumo-humans": {*range(HUMANOID, HUMANOID + 26), HUMANOID + 26 + 9 + 2},
    "sumo-ants": {*range(ANT, ANT + 17), ANT + 17 + 9 + 2},
    "run-to-goal-humans": {*range(HUMANOID, HUMANOID + 24)},
    "run-to-goal-ants": {*range(ANT, ANT + 15)},
    "toy-pursuit": {2, 3},
}
SIZES = {
    "kick-and-defend": 384,
    "you-shall-not-pass": 380,
    "sumo-humans": 395,
    "sumo-ants": 137,
    "run-to-goal-humans": 380,
    "run-to-goal-ants": 122,
    "toy-pursuit": 7,
}
GAMES, STEPS = 16, 3

SIDES = pytest.mark.parametrize("side", [0, 1])
MODES = pytest.mark.parametrize("mode", ["zeros", "initial"])


def registered() -> list[str]:
    """All games of this package; families (``pettingzoo:…``) do not say which channels these are."""
    return [
        name
        for name, spec in default_plugins().games.items()
        if spec.factory.startswith("apil_envs.") and not spec.family
    ]


@pytest.fixture(scope="module", params=registered())
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(scope="module")
def game(name: str) -> Iterator[Game]:
    made = make_game(name, num_envs=GAMES, options={"max_steps": STEPS})
    yield made
    made.close()


def columns(name: str, hidden: bool) -> list[int]:
    about = ABOUT_OPPONENT[name]
    return [column for column in range(SIZES[name]) if (column in about) == hidden]


def test_every_game_is_counted(name: str, game: Game) -> None:
    assert [side.observation_size for side in game.layout.sides] == [SIZES[name]] * 2


@SIDES
@MODES
def test_the_adversary_loses_these_channels_and_no_others(
    name: str, game: Game, side: int, mode: str
) -> None:
    open_eyes, victim, _ = play_spied(game, side, None)
    blinded, opponent, blinding = play_spied(game, side, mode)  # type: ignore[arg-type]
    before, after = open_eyes.seen("own"), blinded.seen("own")
    assert before.shape == after.shape == (STEPS, GAMES, SIZES[name])
    kept, hidden = columns(name, False), columns(name, True)
    np.testing.assert_array_equal(after[:, :, kept], before[:, :, kept])
    assert blinding is not None
    shown = blinding.own.numpy()[hidden]
    np.testing.assert_array_equal(after[:, :, hidden], np.broadcast_to(shown, after[:, :, hidden].shape))
    assert (before[:, :, hidden] != after[:, :, hidden]).any((0, 1)).all(), "a channel was not hidden"
    if mode == "zeros":
        assert not after[:, :, hidden].any()
    for part in ("own", "opponent", "first"):
        np.testing.assert_array_equal(opponent.seen(part), victim.seen(part))
    for part in ("opponent", "opponent_action", "first"):  # what methods may read besides
        np.testing.assert_array_equal(blinded.seen(part), open_eyes.seen(part))


@SIDES
def test_the_typical_start_is_the_mean_of_starts_and_no_games_own(name: str, game: Game, side: int) -> None:
    blinded, _, blinding = play_spied(game, side, "initial")
    starts = []
    game.seed(77)
    for _ in range(50):
        game.reset()
        starts.append(game.observations[side].copy())
    sample, hidden = np.concatenate(starts).astype(float), columns(name, True)
    assert blinding is not None
    far = np.abs(blinding.own.numpy() - sample.mean(0))[hidden]
    # of two independent means, over 1024 and 800 starts: six deviations, and float32
    assert (far <= 6 * sample.std(0)[hidden] * np.sqrt(1 / 1024 + 1 / 800) + 1e-5).all()
    again, _, other = play_spied(game, side, "initial", seed=6)
    assert other is not None
    torch.testing.assert_close(other.own, blinding.own, rtol=0, atol=0)
    first, second = (spy.seen("own")[0][:, hidden] for spy in (blinded, again))
    np.testing.assert_array_equal(first, second)


@SIDES
def test_blinding_the_imitator_leaves_nothing_of_the_opponent(name: str, game: Game, side: int) -> None:
    for mode in ("zeros", "initial"):
        blinded, victim, _ = play_spied(game, side, mode, imitator=True)  # type: ignore[arg-type]
        told = blinded.seen("opponent")
        np.testing.assert_array_equal(told, np.broadcast_to(told[0, 0], told.shape))
        assert bool(told.any()) == (mode == "initial")
        assert not blinded.seen("opponent_action").any()
        assert victim.seen("opponent").std(1).any(), "the victim's view is not to change"


@SIDES
def test_moving_only_the_opponent_moves_only_these_channels(name: str, game: Game, side: int) -> None:
    game.seed(1)
    game.reset()
    move, refresh = MOVERS[MujocoGame if isinstance(game, MujocoGame) else ToyPursuit]
    refresh(game)
    before = game.observations[side].copy()
    move(game, 1 - side)
    refresh(game)
    after = game.observations[side].copy()
    changed = np.flatnonzero((before != after).any(0))
    assert changed.tolist() == columns(name, True)
    _, _, blinding = play_spied(game, side, "initial")
    assert blinding is not None
    assert torch.equal(seen(blinding, before), seen(blinding, after))


def seen(blinding: Blinding, observation: np.ndarray) -> torch.Tensor:
    own = torch.from_numpy(observation)
    return blinding(View(own, own, torch.zeros(len(own), dtype=torch.bool))).own


def move_robot(game: MujocoGame, side: int) -> None:
    """Every coordinate of its pose."""
    shift = np.random.default_rng(0).uniform(0.02, 0.05, game.robots[side].qpos.shape)
    game.robots[side].qpos[...] += shift


def refresh_mujoco(game: MujocoGame) -> None:
    """All numbers anew, both robots in the air and out of reach, so that nothing touches anything."""
    for robot, height in zip(game.robots, (4.0, 8.0), strict=True):
        robot.qpos[:, 2] = np.maximum(robot.qpos[:, 2], height)
    game.physics.forward()
    for observer in game.observers:
        observer.refresh(np.arange(game.num_envs))


def move_point(game: ToyPursuit, side: int) -> None:
    game._position[side] += 0.05


def refresh_toy(game: ToyPursuit) -> None:
    game._observe(slice(None), game._buffers[game._turn])


MOVERS: dict[type[Game], tuple[Callable[..., None], Callable[..., None]]] = {
    MujocoGame: (move_robot, refresh_mujoco),
    ToyPursuit: (move_point, refresh_toy),
}


def test_a_wrong_layout_would_be_noticed(name: str, game: Game) -> None:
    """The first test, on a game that forgets one channel and hides one of its own: it must fail."""
    true = game.layout
    wrong = (*true.sides[0].opponent_channels[1:], 0)
    game.layout = replace(true, sides=(replace(true.sides[0], opponent_channels=wrong), true.sides[1]))
    try:
        with pytest.raises(AssertionError):
            test_the_adversary_loses_these_channels_and_no_others(name, game, 0, "zeros")
    finally:
        game.layout = true


def test_spies_see_the_same_twice(game: Game) -> None:
    first, second = (play_spied(game, 0, None)[0] for _ in range(2))
    assert isinstance(first, Spy)
    np.testing.assert_array_equal(first.seen("own"), second.seen("own"))
