"""The pretrained agents feel at home: their observation filters fit, and they win as often as they should.

The reference are 300 games of an independent prototype (docs/games.md): the keeper won 87 and 3 were ties.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from apil_core import NO_WINNER
from apil_envs.kick_and_defend import KEEPER, KICKER, KickAndDefend

from .zoo_play import Score, agents, play

PROTOTYPE_WINS, PROTOTYPE_GAMES = 87, 300


@pytest.fixture(scope="module")
def played(zoo_dir: Path) -> tuple[Score, tuple[np.ndarray, np.ndarray]]:
    return play(zoo_dir, games=40, num_envs=40, seed=4)


def test_win_rate_is_possible(played: tuple[Score, tuple[np.ndarray, np.ndarray]]) -> None:
    """40 games: wide, but a wrong contact force, inertia or ball friction falls outside."""
    from statsmodels.stats.proportion import proportion_confint

    score, _ = played
    assert score.games == 40
    low, high = proportion_confint(score.keeper_wins, score.games, alpha=0.001, method="wilson")
    assert low < 0.29 < high, f"keeper won {score.keeper_wins} of {score.games}"
    assert score.rate(KICKER) > 0.5
    assert score.rate(NO_WINNER) < 0.1


def test_filters_fit_every_block(zoo_dir: Path, played: tuple[Score, tuple[np.ndarray, np.ndarray]]) -> None:
    """Standardised by the filter of its own training, every block lies around 0 with a spread of about 1."""
    layout = KickAndDefend(1).layout
    for player, side, seen in zip(agents(zoo_dir), layout.sides, played[1], strict=True):
        z = (seen - player.obs_mean) / player.obs_std
        for name, part in side.blocks.items():
            offset, spread = np.abs(z[:, part].mean(0)).mean(), z[:, part].std(0).mean()
            assert offset < 0.6, f"{side.name} {name}: mean off by {offset:.2f} standard deviations"
            assert 0.3 < spread < 1.5, f"{side.name} {name}: spread {spread:.2f}"


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_a_thousand_games(zoo_dir: Path) -> None:
    from statsmodels.stats.proportion import confint_proportions_2indep

    score, _ = play(zoo_dir, games=1000, num_envs=250, seed=1000)
    low, high = confint_proportions_2indep(
        score.keeper_wins, score.games, PROTOTYPE_WINS, PROTOTYPE_GAMES, alpha=0.01
    )
    print(f"keeper {score.rate(KEEPER):.3f}, win+tie {score.rate(KEEPER, NO_WINNER):.3f}, n={score.games}")
    assert low < 0 < high, f"keeper won {score.keeper_wins} of {score.games}"
    assert score.rate(NO_WINNER) < 0.04
