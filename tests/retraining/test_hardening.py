"""Retraining makes a victim better against its attacker, and draws how."""

from __future__ import annotations

from pathlib import Path

import pytest

from apil_core.common.errors import RunDirError
from apil_core.common.statistics import difference
from apil_core.evaluation.results import EvaluationResult
from apil_core.runs.retraining.folder import RetrainDir
from apil_core.runs.retraining.retrain import retrain
from apil_core.runs.retraining.session import RetrainResult
from apil_core.runs.retraining.settings import settings
from apil_core.studies.curves.retraining import draw_opponents, read_opponents
from retraining.victims import runner

GAMES = 250


@pytest.fixture(scope="module")
def hardened(tmp_path_factory: pytest.TempPathFactory) -> RetrainResult:
    """A slow runner, retrained against somebody who chases it."""
    path = tmp_path_factory.mktemp("hardened")
    victim, chaser = (
        runner(path / "slow.safetensors", "gate", 0.8),
        runner(path / "chaser.safetensors", "opponent", 0.35),
    )
    flags = {
        **{
            "env": "toy-pursuit",
            "victim": victim,
            "baseline": "random",
            "threads": 1,
            "recorders": ["jsonl"],
        },
        **{"steps": 12 * 2048, "num_envs": 128, "critic_warmup": 2, "evaluation.episodes": GAMES},
        **{"ppo.num_steps": 16, "ppo.minibatches": 8, "ppo.learning_rate": 3e-3, "ppo.hidden": (32,)},
    }
    return retrain(settings([chaser], flags), out=path / "r")


def gained(before: EvaluationResult, after: EvaluationResult) -> float:
    """Lower end of the 95 % interval of the share of games that the victim wins more often."""
    return difference(after.losses, GAMES, before.losses, GAMES).low


def test_the_victim_wins_more(hardened: RetrainResult) -> None:
    assert set(hardened.after) == {"chaser", "baseline"}
    for label, after in hardened.after.items():
        assert gained(hardened.before[label], after) > 0, label


def test_curves_are_the_victims(hardened: RetrainResult, tmp_path: Path) -> None:
    directory = RetrainDir(hardened.directory)
    groups = {group.label: group for group in read_opponents(directory)}
    assert list(groups) == ["chaser", "baseline"]
    for label, group in groups.items():
        (curve,) = group.curves
        assert [(point.steps, point.episodes) for point in curve.scores] == [(0, GAMES), (24576, GAMES)]
        before, after = (round(GAMES * point.win.value) for point in curve.scores)
        assert before == hardened.before[label].losses
        assert after == hardened.after[label].losses
        line = curve.lines["win"]
        assert line.steps[-1] == hardened.steps
        assert line.low[-1] < line.value[-1] < line.high[-1]
        assert line.value[-1] == pytest.approx((before + after) / 2 / GAMES, abs=0.15)
    draw_opponents(directory, tmp_path / "curve.svg")
    text = (tmp_path / "curve.svg").read_text("utf-8")
    assert "games won by the victim, %" in text
    assert "24,576 steps, seed 0, 50 % of games against the adversaries." in text


def test_too_few_games_are_no_curve(hardened: RetrainResult, tmp_path: Path) -> None:
    young = RetrainDir(tmp_path)
    (tmp_path / "config.yaml").write_bytes((hardened.directory / "config.yaml").read_bytes())
    young.metrics_path.write_text('{"steps": 512, "window_games": 3}\n')
    with pytest.raises(RunDirError, match="3 training games have ended, a curve needs 20"):
        read_opponents(young)
