"""Against finite differences on the toy game, in a tiny MuJoCo run, and every check of a method."""

from __future__ import annotations

import json
from types import SimpleNamespace

import pytest
import torch

from apil_core import DiagonalGaussian
from apil_core.testing import check_method, tiny_config, tiny_run
from apil_saliency.method import Saliency, SaliencyConfig


def test_it_is_the_slope_of_the_victims_action():
    weights = torch.tensor([[1.0, 2.0, -2.0], [0.0, 0.0, 3.0]])

    def replay(rollout, seen):
        return SimpleNamespace(distribution=DiagonalGaussian(seen @ weights.T, torch.tensor([0.5, 1.0])))

    setup = SimpleNamespace(victim=SimpleNamespace(opponent_channels=(1, 2)))
    method = Saliency(SaliencyConfig(weight=0.1), setup)
    seen = torch.tensor([[[1.0, 0.0, 0.0], [0.0, 1.0, 1.0]]])
    run, rollout = (
        SimpleNamespace(victim=SimpleNamespace(replay=replay)),
        SimpleNamespace(victim_observation=seen),
    )
    revised = method.relabel_reward(run, rollout, torch.tensor([[5.0, 7.0]]))
    # game 0: μ = (1, 0): sign (1, 0): (2, −2) / 0.5 → ‖(4, −4)‖; game 1: μ = (0, 3): (0, 3) / 1 → 3
    assert revised[0].tolist() == pytest.approx([5 + 0.1 * 32**0.5, 7 + 0.1 * 3])


def test_a_tiny_run_in_mujoco_has_a_gradient_through_the_recurrent_victim(tmp_path):
    config = tiny_config(
        "saliency",
        "kick-and-defend",
        victim="embedded:kick-and-defend/kicker/v1",
        game={"physics": "fast"},
        num_envs=2,
        steps=2 * 16,
        ppo={"num_steps": 8, "epochs": 1, "minibatches": 1},
    )
    tiny_run(config, tmp_path / "r")
    last = json.loads((tmp_path / "r" / "metrics.jsonl").read_text("utf-8").splitlines()[-1])
    assert last["saliency/sensitivity"] > 0
    assert last["reward/relabelled"] > last["reward/adversary"]
    assert json.loads((tmp_path / "r" / "result.json").read_text("utf-8"))["white_box"] is True


@pytest.mark.slow
def test_it_passes_every_check_of_a_method():
    print(check_method("saliency"))
