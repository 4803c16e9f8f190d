"""A white-box method sees the victim's decisions again, bit for bit, with gradients through its state."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import torch
from helpers.made_plugins import registry_with
from helpers.small_runs import differences, final_state, small_config

from apil_core import (
    Method,
    MethodSpec,
    NetworkShape,
    PluginError,
    VictimError,
    evaluate,
    hookimpl,
    resume,
    run,
    save_policy,
)
from apil_core.cli import main
from apil_core.studies.report.cells import cell, seed_score
from apil_core.training.storage.run_dir import RunDir

INSIDE = {"name": "inside", "requires": (), "white_box": True}


@pytest.fixture
def recurrent(tmp_path: Path) -> str:
    """An untrained LSTM for the toy game's victim."""
    shape = NetworkShape("lstm", 7, 2, width=8, hidden=(4,), clip=5.0)
    draw = torch.Generator().manual_seed(0)
    weights = {name: torch.randn(size, generator=draw) for name, size in shape.tensors().items()}
    weights["observation.std"] = torch.ones(7)
    save_policy(tmp_path / "lstm.safetensors", shape, weights, {})
    return f"safetensors:{tmp_path / 'lstm.safetensors'}"


class Inside(Method):
    """Compares the replayed victim with the one that played; keeps what the tests look at."""

    seen: list[Any] = []

    @hookimpl
    def relabel_reward(self, run, rollout, reward):
        observation = rollout.victim_observation.clone().requires_grad_()
        replayed = run.victim.replay(rollout, observation)
        assert torch.equal(replayed.distribution.mean, rollout.victim_mean)
        assert torch.equal(replayed.distribution.std, rollout.victim_std)
        assert replayed.activations["hidden"].shape[:2] == rollout.done.shape
        last = len(reward) - 1
        (gradient,) = torch.autograd.grad(replayed.distribution.mean[last].sum(), observation)
        self.seen.append((rollout.first.clone(), gradient))
        blind = run.victim.replay(rollout, torch.zeros_like(observation)).distribution
        return reward + 0.01 * replayed.distribution.kl(blind)


def test_the_victim_is_replayed_bit_for_bit_and_gradients_stop_where_games_start(
    tmp_path: Path, recurrent: str
) -> None:
    Inside.seen = []
    config = small_config("looks_inside", victim=recurrent, steps=4 * 512, game={"max_steps": 10})
    methods = [MethodSpec("looks_inside", Inside, white_box=True)]
    run(config, out=tmp_path / "r", methods=methods)
    for first, gradient in Inside.seen:
        reached = gradient.abs().sum(-1) > 0  # (T, n)
        since = first.flip(0).cumsum(0).flip(0) - first.int()  # games that start after the step
        assert reached[-1].all()
        assert not reached[since > 0].any()
        assert reached[-2][~first[-1]].all()  # through the recurrent state
    assert any(first[1:].any() for first, _ in Inside.seen)
    # rollouts of 16 steps and games of 10: a rollout starts in the middle of games, also after a resume
    middle = RunDir(tmp_path / "r").checkpoints()[0]
    whole = final_state(tmp_path / "r")
    resume(tmp_path / "r", checkpoint_path=middle, methods=methods)
    again = final_state(tmp_path / "r")
    for part in ("learner", "env", "methods"):
        assert not differences(whole[part], again[part])


def test_scores_results_and_listings_say_white_box(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    registry = registry_with(Inside, **INSIDE)
    config = small_config("inside", steps=512, evaluation={"episodes": 2})
    made = run(config, out=tmp_path / "runs" / "r", plugins=registry)
    assert made.white_box
    assert made.evaluation is not None
    assert made.evaluation.white_box
    column = [seed_score(made.evaluation, "r", seed=0)]
    assert cell("toy-pursuit", "inside", column, None, ["1 seed"]).marks == ["1 seed", "white box"]
    assert evaluate(tmp_path / "runs" / "r", episodes=2, plugins=registry).white_box
    plain = run(small_config("adrl", steps=512), out=tmp_path / "runs" / "plain")
    assert not plain.white_box
    with pytest.raises(SystemExit):
        main(["runs", "list", str(tmp_path / "runs"), "--json"])
    assert capsys.readouterr().out.count('"white_box": true') == 2  # the run, and its score


def test_without_the_statement_it_is_one_error(tmp_path: Path) -> None:
    with pytest.raises(PluginError, match="method 'inside' may not see inside the victim; if it should"):
        run(
            small_config("inside", steps=512), out=tmp_path / "r", plugins=registry_with(Inside, "inside", ())
        )


@pytest.mark.parametrize("victim", ["random", "zero"])
def test_a_victim_without_gradients_is_one_error(tmp_path: Path, victim: str) -> None:
    with pytest.raises(VictimError, match=r"and baseline:.* has no gradients; zoo:"):
        run(
            small_config("inside", victim=victim), out=tmp_path / "r", plugins=registry_with(Inside, **INSIDE)
        )
    assert not (tmp_path / "r").exists()


def test_rollouts_of_other_games_are_refused(tmp_path: Path) -> None:
    class Elsewhere(Method):
        @hookimpl
        def update_auxiliary(self, run, rollout):
            run.victim.replay(run.collect(_Still(), 2))

    with pytest.raises(PluginError, match="this rollout is not one of the training games"):
        run(small_config("inside"), out=tmp_path / "r", plugins=registry_with(Elsewhere, **INSIDE))


class _Still:
    info = None

    def act(self, view, *, sample, generator=None, activations=False):
        from apil_core import Decision

        return Decision(view.own.new_zeros(len(view.own), 2))

    def recurrent_state(self):
        return {}
