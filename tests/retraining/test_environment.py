"""The run's environment with the seats swapped: who acts when, what is rewarded, whose view is counted."""

from __future__ import annotations

from pathlib import Path

import torch

from apil_core import Decision, Policy, View
from apil_core.api.policy import PolicyInfo
from apil_core.plugins.registry import default_plugins
from apil_core.runs.retraining.build import prepare
from apil_core.runs.retraining.settings import settings
from retraining.victims import runner, student

GAMES = 4


class Oracle(Policy):
    """Stands still, and keeps what it was shown."""

    def __init__(self) -> None:
        self.info = PolicyInfo("oracle", "", 7, 2)
        self.views: list[View] = []

    def act(self, view, *, sample, generator=None, activations=False):
        self.views.append(view)
        return Decision(torch.zeros(len(view.own), 2))


def test_the_victim_acts_first_and_only_the_outcome_is_rewarded(tmp_path: Path) -> None:
    victim = student(tmp_path / "s.safetensors", "mlp")
    flags = {"env": "toy-pursuit", "victim": victim, "baseline": "random", "threads": 1, "num_envs": GAMES}
    config = settings([runner(tmp_path / "c.safetensors", "opponent", 0.35)], {**flags, "ppo.num_steps": 60})
    trainer = prepare(config, default_plugins())
    env = trainer.attack.env
    oracle = Oracle()
    env.victim.policies = [oracle, Oracle()]
    played = []
    for step in range(60):
        own = env.pending.view.own.clone()
        assert len(oracle.views) == step  # it has not been asked before the victim acted
        played.append(torch.full((GAMES, 2), step / 60))
        env.step(played[-1])
        assert torch.equal(oracle.views[-1].opponent_action, played[-1])
        assert torch.equal(oracle.views[-1].opponent, own)
    rollout = env.finish_rollout()
    assert rollout.done.any()
    assert not rollout.reward[~rollout.done].any()
    weight = env.weights.sparse_weight
    assert set(rollout.reward[rollout.done].abs().tolist()) <= {0.0, 10 * weight, 100 * weight, 1000 * weight}
    metrics = env.stats.metrics()
    wins, losses = metrics["window_wins"], metrics["window_losses"]
    assert wins + losses + metrics["window_ties"] == metrics["games"] == rollout.done.sum()
    assert metrics["cause/escaped"] == wins  # the victim is the one that runs for the gate
    trainer.attack.game.close()
