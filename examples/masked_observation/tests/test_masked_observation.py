"""The masked-observation defence: the masked columns and sides, in training and in evaluation."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

from apil_core import ConfigError, Context, GameLayout, MethodSetup, PPOConfig, SideLayout, evaluate
from apil_core.testing import tiny_config, tiny_run
from apil_masked_observation.observer import MaskedObservation
from apil_masked_observation.options import MaskedObservationOptions

GAMES = 4000
SEAT = SideLayout("kicker", 4, 1, -1.0, 1.0, opponent_channels=(1, 3))
OTHER = SideLayout("keeper", 2, 1, -1.0, 1.0)
OBSERVED = torch.tensor([1.0, 2.0, 3.0, 4.0]).expand(GAMES, 4)
CPU = torch.device("cpu")


def observer(way: Any, victim: SideLayout = SEAT, **options: Any) -> MaskedObservation:
    layout = GameLayout((victim, OTHER), 10, ("won",))
    setup = MethodSetup(layout, 1, CPU, 0, PPOConfig(), {})
    return MaskedObservation(MaskedObservationOptions(way=way, **options), setup)


def context(role: Any = "victim", mode: Any = "train", seed: int = 0) -> Context:
    generator = torch.Generator().manual_seed(seed)
    return Context(side=0, role=role, seat=SEAT, mode=mode, device=CPU, generator=generator)


def seen(way: Any, obs: torch.Tensor = OBSERVED, **options: Any) -> torch.Tensor:
    found = observer(way, **options).filter_observation(context=context(), obs=obs)
    assert found is not None
    return found


def test_zeros_stand_where_the_opponent_was():
    assert torch.equal(seen("zeros"), torch.tensor([1.0, 0.0, 3.0, 0.0]).expand(GAMES, 4))
    assert torch.equal(OBSERVED[0], torch.tensor([1.0, 2.0, 3.0, 4.0]))


def test_noise_is_standard_normal_and_comes_from_the_contexts_generator():
    assert torch.equal(seen("noise")[:, [0, 2]], OBSERVED[:, [0, 2]])
    drawn = seen("noise")[:, [1, 3]]
    # 8000 draws: the mean's standard deviation is 0.011, that of the standard deviation 0.008
    assert abs(float(drawn.mean())) < 0.05
    assert abs(float(drawn.std()) - 1) < 0.04
    assert torch.equal(seen("noise"), seen("noise"))
    other = observer("noise").filter_observation(context=context(seed=1), obs=OBSERVED)
    assert not torch.equal(seen("noise"), other)


@pytest.mark.parametrize("share", [0.25, 0.5, 1.0])
def test_dropout_blanks_both_columns_of_a_share_of_the_games(share: float):
    found = seen("dropout", share=share)
    blank = (found == torch.tensor([1.0, 0.0, 3.0, 0.0])).all(1)
    untouched = (found == OBSERVED).all(1)
    assert bool((blank ^ untouched).all())
    # a share of 4000 draws: its standard deviation is 0.008 at most
    assert abs(float(blank.float().mean()) - share) < 0.04


def test_means_are_those_of_all_training_observations_and_evaluations_leave_them_alone():
    masked = observer("mean")
    first = torch.tensor([[0.0, 1.0, 0.0, 10.0], [0.0, 3.0, 0.0, 30.0]])
    second = torch.tensor([[5.0, 8.0, 6.0, 20.0], [7.0, 4.0, 8.0, 40.0]])
    at_first = masked.filter_observation(context=context(), obs=first)
    assert at_first is not None
    assert at_first.tolist() == [[0, 2, 0, 20], [0, 2, 0, 20]]
    then = masked.filter_observation(context=context(), obs=second)
    assert then is not None
    assert then.tolist() == [[5, 4, 6, 25], [7, 4, 8, 25]]  # (1 + 3 + 8 + 4) / 4, (10 + 30 + 20 + 40) / 4
    scored = masked.filter_observation(context=context(mode="eval"), obs=second * 100)
    assert scored is not None
    assert scored[:, [1, 3]].tolist() == [[4, 25], [4, 25]]


def test_means_survive_a_restart_and_without_any_there_is_one_line():
    trained, fresh = observer("mean"), observer("mean")
    trained.filter_observation(context=context(), obs=OBSERVED)
    with pytest.raises(ConfigError, match="way mean needs a run that was trained with it"):
        fresh.filter_observation(context=context(mode="eval"), obs=OBSERVED)
    fresh.load_state_dict(trained.state_dict())
    assert torch.equal(
        fresh.filter_observation(context=context(mode="eval"), obs=torch.zeros_like(OBSERVED))[0],
        torch.tensor([0.0, 2.0, 0.0, 4.0]),
    )


@pytest.mark.parametrize("way", ["zeros", "mean", "noise", "dropout"])
def test_the_adversary_sees_everything(way: Any):
    assert observer(way).filter_observation(context=context("adversary"), obs=OBSERVED) is None


def test_a_game_that_does_not_name_the_columns_is_one_line():
    with pytest.raises(ConfigError, match="nothing to mask: .* channels of the kicker's observation"):
        observer("zeros", victim=replace(SEAT, opponent_channels=()))


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
    witnesses = [tmp_path / "unmasked.py", tmp_path / "masked.py"]
    for file in witnesses:
        file.write_text(WITNESS)
    config = tiny_config(
        steps=64,
        num_envs=8,
        ppo={"num_steps": 8, "epochs": 1, "minibatches": 2},
        plugins=tuple(str(file) for file in witnesses),
        observers=("unmasked", "masked_observation", "masked"),
    )
    tiny_run(config, tmp_path / "run")
    score = evaluate(tmp_path / "run", episodes=5)
    assert score.observers == {
        "unmasked": {},
        "masked_observation": {"way": "zeros", "share": 0.5},
        "masked": {},
    }
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
            assert after["all"] == pytest.approx(before["all"] - before["about"], abs=1e-4 * before["all"])
