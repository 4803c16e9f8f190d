"""What ``apil_core.Game`` asks for, of every game of this package.

They are those that ``check_game`` holds third parties' games to; the views' are in games/test_views.py.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from helpers.every_game import GAME_NAMES, short_game

from apil_core import NO_WINNER, Game
from apil_core.plugins.registry import default_plugins
from apil_core.testing.game_checks import CHECKS
from apil_core.testing.game_play import Play, Trial
from apil_core.testing.games import check_spec, maker
from apil_envs.game_base import MujocoGame

GAMES = 6
MUJOCO_GAMES = [name for name in GAME_NAMES if isinstance(short_game(name), MujocoGame)]


def started(game: Game, seed: int = 0) -> Game:
    game.seed(seed)
    game.reset()
    return game


_NAMES = [
    # the same bodies in a scene without a ball or a ring: slow, since the other games say the same
    pytest.param(name, marks=pytest.mark.slow if name.startswith("run-to-goal") else [])
    for name in GAME_NAMES
]


@pytest.mark.parametrize("check", [name for name in CHECKS if name != "views"])
@pytest.mark.parametrize("name", _NAMES)
def test_a_game_passes_each_check(name: str, check: str) -> None:
    trial = Trial(name, maker(default_plugins(), name))
    CHECKS[check](trial)
    assert not trial.skipped


@pytest.mark.parametrize("name", GAME_NAMES)
def test_its_spec_is_sound(name: str) -> None:
    trial = Trial(name, maker(default_plugins(), name))
    check_spec(trial, default_plugins())
    assert not trial.skipped


@pytest.mark.parametrize("poison", [np.nan, np.inf, 1e30, -2e10])
@pytest.mark.parametrize("name", MUJOCO_GAMES)
def test_divergence_ends_that_game_alone(
    name: str, poison: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    broken, sane = started(short_game(name, GAMES), 1), started(short_game(name, GAMES), 1)
    assert isinstance(broken, MujocoGame)
    play = Play(sane, 3)
    broken.physics.qvel[2, 7] = poison
    actions = play.actions()
    step, expected = broken.step(actions), sane.step(actions)
    others = np.arange(GAMES) != 2
    assert step.done[2]
    assert step.winner[2] == NO_WINNER
    assert broken.layout.causes[step.cause[2]] == "diverged"
    for reward in (step.sparse, step.dense, step.shaping):
        assert (reward[:, 2] == 0).all()
    assert not step.done[others].any()
    assert list(tmp_path.iterdir()) == [], "MuJoCo leaves no log in the current folder"
    np.testing.assert_array_equal(step.dense[:, others], expected.dense[:, others])
    for seen, wanted in zip(broken.observations, sane.observations, strict=True):
        assert np.isfinite(seen).all()
        np.testing.assert_array_equal(seen[others], wanted[others])
    broken.reset(step.done)
    after = broken.step(actions)
    assert np.isfinite(after.dense).all()
    assert not after.done.any()
