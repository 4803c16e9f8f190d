"""Counts of ended games: wins and endings of the same games, returns in the game's reward."""

from __future__ import annotations

import pytest
import torch

from apil_core.api.types import StepBatch
from apil_core.training.episode_stats import WINDOW, EpisodeStats

CAUSES = ("goal", "time-up")


def step(outcome: list[int], cause: list[int], sparse: float = 0.0, dense: float = 0.0) -> StepBatch:
    """A step of games that all end with it; the training reward is another one than the game's."""
    n = len(outcome)
    one, none = torch.ones(n), torch.zeros(n, 1)
    return StepBatch(
        observation=none,
        victim_observation=none,
        action=none,
        victim_action=none,
        victim_distribution=None,
        reward=77 * one,
        victim_reward=-77 * one,
        normalized_reward=one,
        normalized_victim_reward=one,
        sparse=torch.stack([sparse * one, -sparse * one]),
        dense=torch.stack([dense * one, dense * one]),
        first=one.bool(),
        done=one.bool(),
        outcome=torch.tensor(outcome, dtype=torch.int8),
        cause=torch.tensor(cause),
    )


def test_endings_are_of_the_games_that_wins_are_of() -> None:
    stats = EpisodeStats(4, CAUSES, torch.device("cpu"))
    for _ in range(WINDOW // 4):
        stats.add(step([-1] * 4, [1] * 4), {})
    stats.metrics()
    for _ in range(100):  # of 1000 games, 400 are new
        stats.add(step([1, 1, 1, 0], [0, 0, 0, 1]), {})
    found = stats.metrics()
    assert (found["window_games"], found["window_wins"], found["window_losses"]) == (1000, 300, 600)
    assert (found["window_cause/goal"], found["window_cause/time-up"]) == (300, 700)
    assert (found["cause/goal"], found["cause/time-up"]) == (300, 100)
    again = EpisodeStats(4, CAUSES, torch.device("cpu"))
    again.load_state_dict(stats.state_dict())
    assert again.metrics()["window_cause/goal"] == 300


def test_returns_are_sums_of_the_games_own_reward() -> None:
    stats = EpisodeStats(2, CAUSES, torch.device("cpu"))
    stats.add(step([1, 1], [0, 0], sparse=1000.0, dense=-0.25), {})
    found = stats.metrics()
    assert found["return/adversary"] == pytest.approx(999.75)
    assert found["return/victim"] == pytest.approx(-1000.25)


def test_a_checkpoint_without_the_windows_endings_is_read() -> None:
    stats = EpisodeStats(2, CAUSES, torch.device("cpu"))
    stats.add(step([1, 0], [0, 1]), {})
    state = stats.state_dict()
    del state["window_causes"]
    stats.load_state_dict(state)
    found = stats.metrics()
    assert (found["window_games"], found["window_cause/goal"]) == (2, 0)
