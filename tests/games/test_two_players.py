"""The step of two players: who sees what, when games start anew, and what the next step leaves alone."""

from __future__ import annotations

import numpy as np
import torch

from apil_core.games.two_players import TwoPlayerGames
from apil_core.plugins.registry import make_game


def games(num_envs: int = 3, **options: object) -> TwoPlayerGames:
    game = make_game("toy-pursuit", num_envs=num_envs, options=options)
    game.seed(0)
    return TwoPlayerGames(game)


def still(num_envs: int) -> torch.Tensor:
    return torch.zeros(num_envs, 2)


def test_each_side_gets_its_own_action_and_observation() -> None:
    played = games()
    played.reset()
    before = [played.observation(side).clone() for side in (0, 1)]
    towards = torch.tensor([[1.0, 0.0]]).expand(3, 2)
    played.step({1: towards, 0: still(3)})
    evader, pursuer = (played.observation(side)[:, :2] - before[side][:, :2] for side in (0, 1))
    assert evader.abs().max() == 0
    assert (pursuer[:, 0] > 0).all()
    view = played.view(1, still(3))
    assert view.own is played.observation(1)
    assert view.opponent is played.observation(0)
    assert view.opponent_action is not None
    assert played.view(0).opponent_action is None


def test_first_marks_the_games_that_start_with_the_present_observation() -> None:
    played = games(2, max_steps=3)
    played.reset()
    assert played.first.tolist() == [True, True]
    away = {0: still(2), 1: still(2)}
    for _ in range(2):
        result = played.step(away)
        played.reset(result.done)
        assert played.first.tolist() == [False, False]
    result = played.step(away, np.array([True, False]))  # the second game stands still
    assert result.done.tolist() == [True, False]
    assert played.first.tolist() == [False, False]  # over, but not started anew
    played.reset(result.done)
    assert played.first.tolist() == [True, False]
    assert played.observation(0)[:, 6].tolist() == [1.0, np.float32(1 - 2 / 3)]  # time left


def test_an_observation_outlives_the_next_step() -> None:
    played = games()
    played.reset()
    seen = played.view(0)
    kept = seen.own.clone()
    played.reset(played.step({0: torch.ones(3, 2), 1: still(3)}).done)
    assert torch.equal(seen.own, kept)
    assert not torch.equal(played.observation(0), kept)


def test_a_filter_is_asked_once_for_each_side_and_step() -> None:
    asked = []

    def halved(side: int, observation: torch.Tensor) -> torch.Tensor:
        asked.append(side)
        return observation / 2

    game = games().game
    played = TwoPlayerGames(game, observation_filter=halved)
    played.reset()
    view = played.view(0)
    played.view(1, still(3))
    assert asked == [0, 1]
    assert torch.equal(view.own * 2, torch.from_numpy(game.observations[0]))
    played.step({0: still(3), 1: still(3)})
    played.view(1)
    assert asked == [0, 1, 1, 0]
