"""The masked-observation defence: what it hides, from whom, in training and in evaluation."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import torch

from apil_core import ConfigError, Context, SideLayout, evaluate
from apil_core.testing import tiny_config, tiny_run
from apil_masked_observation import dropout, noise, zeros

GAMES = 4000
SEAT = SideLayout("kicker", 4, 1, -1.0, 1.0, opponent_channels=(1, 3))
OBSERVED = torch.tensor([1.0, 2.0, 3.0, 4.0]).expand(GAMES, 4)


def context(role: Any = "victim", seat: SideLayout = SEAT, seed: int = 0) -> Context:
    generator = torch.Generator().manual_seed(seed)
    return Context(side=0, role=role, seat=seat, mode="eval", device=torch.device("cpu"), generator=generator)


def test_zeros_stand_where_the_opponent_was():
    seen = zeros.filter_observation(context=context(), side=0, obs=OBSERVED)
    assert torch.equal(seen, torch.tensor([1.0, 0.0, 3.0, 0.0]).expand(GAMES, 4))
    assert torch.equal(OBSERVED[0], torch.tensor([1.0, 2.0, 3.0, 4.0]))


def test_noise_is_standard_normal_and_comes_from_the_contexts_generator():
    seen = noise.filter_observation(context=context(), side=0, obs=OBSERVED)
    assert torch.equal(seen[:, [0, 2]], OBSERVED[:, [0, 2]])
    drawn = seen[:, [1, 3]]
    # 8000 draws: the mean's standard deviation is 0.011, that of the standard deviation 0.008
    assert abs(float(drawn.mean())) < 0.05
    assert abs(float(drawn.std()) - 1) < 0.04
    assert torch.equal(seen, noise.filter_observation(context=context(), side=0, obs=OBSERVED))
    other = noise.filter_observation(context=context(seed=1), side=0, obs=OBSERVED)
    assert not torch.equal(seen, other)


def test_dropout_blanks_both_columns_of_half_the_games():
    seen = dropout.filter_observation(context=context(), side=0, obs=OBSERVED)
    blank = (seen == torch.tensor([1.0, 0.0, 3.0, 0.0])).all(1)
    untouched = (seen == OBSERVED).all(1)
    assert bool((blank ^ untouched).all())
    # a share of 4000 draws with probability one half: its standard deviation is 0.008
    assert abs(float(blank.float().mean()) - 0.5) < 0.04


@pytest.mark.parametrize("way", [zeros, noise, dropout])
def test_the_adversary_sees_everything(way: Any):
    assert way.filter_observation(context=context("adversary"), side=0, obs=OBSERVED) is None


@pytest.mark.parametrize("way", [zeros, noise, dropout])
def test_a_game_that_does_not_name_the_columns_is_one_line(way: Any):
    nameless = SideLayout("kicker", 4, 1, -1.0, 1.0)
    with pytest.raises(ConfigError, match="nothing to mask: .* channels of the kicker's observation"):
        way.filter_observation(context=context(seat=nameless), side=0, obs=OBSERVED)


WITNESS = """
import json
from pathlib import Path
from apil_core import hookimpl

@hookimpl
def filter_observation(context, side, obs):
    about = obs[:, list(context.seat.opponent_channels)]
    told = {"mode": context.mode, "role": context.role, "all": float(obs.abs().sum()),
            "about": float(about.abs().sum())}
    with Path(__file__).with_suffix(".jsonl").open("a") as file:
        file.write(json.dumps(told) + "\\n")
"""


def told(file: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in file.with_suffix(".jsonl").read_text().splitlines()]


def test_the_victims_view_changes_in_training_and_evaluation_and_the_adversarys_does_not(tmp_path: Path):
    witnesses = [tmp_path / "before.py", tmp_path / "after.py"]
    for file in witnesses:
        file.write_text(WITNESS)
    config = tiny_config(
        steps=64,
        num_envs=8,
        ppo={"num_steps": 8, "epochs": 1, "minibatches": 2},
        plugins=tuple(str(file) for file in witnesses),
        observers=("before", "masked_zeros", "after"),
    )
    tiny_run(config, tmp_path / "run")
    evaluate(tmp_path / "run", episodes=5)
    pairs = list(zip(*(told(file) for file in witnesses), strict=True))
    assert {(before["mode"], before["role"]) for before, _ in pairs} == {
        (mode, role) for mode in ("train", "eval") for role in ("adversary", "victim")
    }
    for before, after in pairs:
        if before["role"] == "adversary":
            assert before == after
        else:
            assert after["about"] == 0.0
            assert before["about"] > 0.0
            assert after["all"] == pytest.approx(before["all"] - before["about"], rel=1e-4)
