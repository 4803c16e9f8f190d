"""The noise method: the policy does not change, and settings that would change it are refused."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
from torch import Tensor

from apil_core import ConfigError
from apil_core.testing import check_method, tiny_config, tiny_run
from apil_noise.method import what_moves_it

SMALL = {"num_envs": 8, "ppo": {"num_steps": 8, "epochs": 1, "minibatches": 2}}


@pytest.fixture(scope="module")
def states(tmp_path_factory: pytest.TempPathFactory):
    """States of a run of two iterations, after the first and after the second."""
    out = tmp_path_factory.mktemp("noise") / "run"
    tiny_run(tiny_config("noise", steps=2 * 64, checkpoint={"every_iterations": 1}, **SMALL), out)
    return [torch.load(path, weights_only=True) for path in sorted((out / "checkpoints").glob("*.pt"))]


def moved(before: dict[str, Tensor], after: dict[str, Tensor]) -> list[str]:
    assert before.keys() == after.keys()
    return [name for name, weights in before.items() if not torch.equal(weights, after[name])]


def test_the_policy_does_not_move_and_the_critic_does(states):
    first, second = (state["learner"]["ppo"] for state in states)
    assert moved(first["actor_state_dict"], second["actor_state_dict"]) == []
    assert moved(first["critic_state_dict"], second["critic_state_dict"]) != []


def test_the_policy_is_the_one_every_method_begins_with(states):
    actor = states[-1]["learner"]["ppo"]["actor_state_dict"]
    (spread,) = (value for name, value in actor.items() if "log_std" in name)
    assert spread.tolist() == [0.0, 0.0]  # ppo.init_std is 1: its logarithm is 0
    last = [value for name, value in actor.items() if name.endswith("weight")][-1]
    # two orthogonal rows of length 0.01: the mean of an action is at most 0.01 · |h|, h in [-1, 1]^64
    torch.testing.assert_close(last @ last.T, 1e-4 * torch.eye(2))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"ppo": {"entropy_coefficient": 0.01, "num_steps": 8}},
            "ppo.entropy_coefficient must be 0, got 0.01",
        ),
        ({"ppo": {"optimizer": "adamw", "num_steps": 8}}, "ppo.optimizer must be adam, got adamw"),
    ],
)
def test_what_would_move_the_policy_is_refused(changes: dict, message: str, tmp_path: Path):
    with pytest.raises(ConfigError, match=f"method noise never learns: {message}"):
        tiny_run(tiny_config("noise", **{**SMALL, **changes}), tmp_path / "run")


def test_another_runs_policy_is_no_noise(tmp_path: Path):
    config = tiny_config("noise").model_copy(update={"init_from": tmp_path})
    assert "init_from must be empty" in str(what_moves_it(config))


@pytest.mark.slow
def test_it_passes_every_check_of_a_method():
    print(check_method("noise"))
