"""KL between a real run's checkpoints in games that are played, and its bound."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import torch
from helpers.small_runs import three_iterations
from studies.paper_runs import row, write_run

from apil_core import ConfigError, RunDirError
from apil_core.api.policy import Policy, PolicyInfo
from apil_core.api.types import Decision, DiagonalGaussian, View
from apil_core.studies.theory.diagnostics import KL, diagnose
from apil_core.training.storage.run_dir import RunDir
from apil_theory.compared_games import ComparedGames, ComparedPolicy
from apil_theory.policy_change import PolicyChange, _compare, policy_changes

BIT = math.log(2)


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> RunDir:
    return three_iterations(tmp_path_factory.mktemp("theory") / "run")


@pytest.fixture(scope="module")
def changes(trained: RunDir) -> list[PolicyChange]:
    return policy_changes(trained, games=20, seed=3)


def test_what_cannot_be_compared(tmp_path: Path, trained: RunDir) -> None:
    with pytest.raises(RunDirError, match="keeps 0 checkpoints"):
        policy_changes(write_run(tmp_path / "r", [row(1000, 30, 0)]), games=2)
    with pytest.raises(ConfigError, match="games must be at least 2, got 1"):
        policy_changes(trained, games=1)


def test_changes_between_kept_checkpoints(changes: list[PolicyChange]) -> None:
    assert [(change.steps_before, change.steps_after) for change in changes] == [(512, 1024), (1024, 1536)]
    for change in changes:
        assert 0 < change.kl_mean < change.kl_max < 1
        assert change.games == 20
        assert change.states > 20 * 3
        # a game of at most 50 steps is far from 1 / (1 − γ) = 100
        assert 0 < change.bound_visits < change.bound_max
        assert change.largest_value == pytest.approx(10.0)  # a game's end is worth ±1000 · 0.01
        assert change.value_before.low <= change.value_before.value <= change.value_before.high
        difference = change.value_after.value - change.value_before.value
        assert change.change.value == pytest.approx(difference)
        assert abs(difference) < change.bound_visits
    assert changes[0].value_after == changes[1].value_before  # the same games


def test_the_logs_kl_is_of_one_update(trained: RunDir, changes: list[PolicyChange]) -> None:
    """Exact KL of the scored policies also has the normaliser and the imitator in it, so not less by much."""
    lines = diagnose(trained).lines
    logged = dict(zip(lines[KL].steps, lines[KL].value, strict=True))
    for change in changes:
        assert 0.3 * logged[change.steps_after] < change.kl_mean < 30 * logged[change.steps_after]


class Normal(Policy):
    """The same normal distribution in every state."""

    def __init__(self, mean: float, std: float):
        self.info = PolicyInfo("normal", "", 1, 1)
        self.mean, self.std = mean, std

    def act(self, view: View, **_: object) -> Decision:
        mean = torch.full((len(view.own), 1), self.mean)
        return Decision(mean, DiagonalGaussian(mean, torch.full((1,), self.std)))


def test_kl_is_from_before_to_after_in_bits() -> None:
    """KL(N(0, 1) ‖ N(1, 2²)) = ln 2 + (1 + 1) / 8 − ½ nats; the other way round it is 1.306."""
    compared = ComparedPolicy(Normal(0.0, 1.0), Normal(1.0, 2.0))
    compared.act(View(torch.zeros(3, 1), torch.zeros(3, 1), torch.ones(3, dtype=torch.bool)), sample=True)
    assert compared.divergence == pytest.approx(np.full(3, (math.log(2) - 0.25) / BIT), rel=1e-6)


def test_values_of_games_by_hand() -> None:
    """A reward of 8 in the third step: 2, 4, 8 from each step on, Γ = γ · 2; the other game ends at once."""
    playing = np.array([[True, True], [True, False], [True, False]])
    rewards = np.array([[0.0, -6.0], [0.0, 0.0], [8.0, 0.0]])
    games = ComparedGames(0, 0.5, playing, rewards, np.full((3, 2), 4.0))
    np.testing.assert_allclose(games.following, [[2, -6], [4, 0], [8, 0]])
    np.testing.assert_allclose(games.values, [1, -3])
    change = _compare(games, games)
    assert (change.states, change.kl_mean, change.largest_value) == (4, 4.0, 8.0)
    # Σ γ^t √4 is 2 · 1.75 in the first game and 2 in the second: 2.75 on average
    assert change.bound_visits == pytest.approx(0.5 * 8 * 1.1774100 * 2.75)
    assert change.bound_max == pytest.approx(0.5 * 8 * 1.1774100 / 0.5 * 2)


def test_a_policy_is_no_distance_from_itself(trained: RunDir, tmp_path: Path) -> None:
    """Two copies of the same weights: the KL is zero for every draw."""
    copy = tmp_path / "copy"
    (copy / "checkpoints").mkdir(parents=True)
    (copy / "config.yaml").write_bytes(trained.config_path.read_bytes())
    newest = trained.newest_checkpoint().read_bytes()
    for number in (1, 2):
        (copy / f"checkpoints/iteration-{number:08d}.pt").write_bytes(newest)
    (change,) = policy_changes(RunDir(copy), games=2)
    assert (change.kl_mean, change.kl_max, change.bound_max, change.change.value) == (0, 0, 0, 0)
