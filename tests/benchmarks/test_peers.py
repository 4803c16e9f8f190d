"""The comparison with other frameworks runs, and its arithmetic is right. How fast anybody is, is no test."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

PEERS = Path(__file__).resolve().parents[2] / "benchmarks" / "peers"


@pytest.fixture
def peers(monkeypatch):
    """The comparison's modules can be imported, as when its script runs."""
    monkeypatch.syspath_prepend(str(PEERS))


@pytest.mark.slow
def test_all_train_on_the_toy_game(tmp_path):
    pytest.importorskip(
        "stable_baselines3", reason="no stable_baselines3 here (benchmarks/peers/requirements.txt)"
    )
    out = tmp_path / "peers.json"
    toy = ("--env", "toy-pursuit", "--batch", "128", "--num-envs", "16", "--seconds", "0", "--block", "0")
    peers = ("--methods", "adrl", "e_apil", "--sb3", "dummy:2", "subproc:1", "--json", str(out))
    command = [sys.executable, str(PEERS / "compare.py"), *toy, *peers]
    done = subprocess.run(command, capture_output=True, text=True, timeout=200, check=False)
    assert done.returncode == 0, done.stderr
    report = json.loads(out.read_text())
    names = ["apil adrl", "apil e_apil", "sb3 dummy:2", "sb3 subproc:1", "rsl_rl runner"]
    assert [one["contestant"] for one in report["standings"]] == names
    assert [(b["turn"], b["contestant"]) for b in report["blocks"]] == [(t, n) for t in (0, 1) for n in names]
    assert all(block["rate"] > 0 and block["physics"] is None for block in report["blocks"])
    assert report["sb3_reference"] in ("sb3 dummy:2", "sb3 subproc:1")
    assert report["task"]["victim"] == "scripted:toy-pursuit/evader/v1"
    assert "toy-pursuit has no physics that can be timed apart" in done.stderr
    assert all(name in done.stdout for name in names)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--env", "toy"], "unknown game 'toy'"),
        (
            ["--env", "toy-pursuit", "--sb3", "threads:2"],
            "--sb3 'threads:2': must be dummy:N, subproc:N or batch:N",
        ),
        (["--env", "toy-pursuit", "--sb3", "dummy:3"], "a batch of 128 steps cannot be shared by 3 games"),
    ],
)
def test_a_mistake_is_one_line(peers, monkeypatch, arguments, message):
    if "--sb3" in arguments:
        pytest.importorskip("stable_baselines3", reason="no stable_baselines3 here")
    from compare import main

    fixed = ["compare.py", "--batch", "128", "--num-envs", "16", "--methods", "--no-rsl-rl"]
    monkeypatch.setattr(sys, "argv", [*fixed, *arguments])
    with pytest.raises(SystemExit, match=f"compare.py: {message}"):
        main()


def test_what_is_missing_is_named(peers, monkeypatch):
    monkeypatch.delitem(sys.modules, "sb3_peer", raising=False)
    monkeypatch.setitem(sys.modules, "stable_baselines3", None)
    monkeypatch.setattr(sys, "argv", ["compare.py", "--env", "toy-pursuit", "--methods", "--no-rsl-rl"])
    from compare import main

    with pytest.raises(SystemExit, match=r"no stable_baselines3 here; pip install -r .*requirements\.txt"):
        main()


def test_standings(peers):
    from blocks import Block, Spread, sb3_reference, standings

    rates = {"apil adrl": (900.0, 800.0), "sb3 dummy:8": (300.0, 200.0), "sb3 subproc:1": (100.0, 220.0)}
    physics = {"apil adrl": 1000.0, "sb3 dummy:8": 800.0, "sb3 subproc:1": 1000.0}
    blocks = [Block(name, turn, rate[turn], physics[name]) for turn in (0, 1) for name, rate in rates.items()]
    assert sb3_reference(blocks) == "sb3 dummy:8"  # medians 250 and 160
    ours = standings(blocks)[0]
    assert ours.rate == Spread(850.0, 800.0, 900.0)
    assert ours.of_physics == Spread(pytest.approx(0.85), 0.8, 0.9)
    assert ours.over_sb3 == Spread(3.5, 3.0, 4.0)  # 900/300 and 800/200, round by round
    assert ours.over_sb3_beside_physics == Spread(pytest.approx(2.8), pytest.approx(2.4), pytest.approx(3.2))


def test_standings_without_physics_and_sb3(peers):
    from blocks import Block, standings, table

    blocks = [Block("apil adrl", 0, 10.0, None)]
    assert (standings(blocks)[0].of_physics, standings(blocks)[0].over_sb3) == (None, None)
    assert "SB3 is absent" in table(blocks)


def test_pure_physics_repeats_what_was_played(peers):
    from pure_physics import RECORDED, PurePhysics
    from task import Task

    task = Task("sumo-ants", {}, "zero", batch=128, num_envs=2, threads=1)
    physics = PurePhysics(task)
    physics.warm_up()
    steps, seconds = physics.timed()
    assert steps == 2 * RECORDED
    assert seconds > 0
    physics.close()


def test_peers_have_our_settings(peers):
    pytest.importorskip("stable_baselines3", reason="no stable_baselines3 here")
    from rsl_rl_peer import RslRl
    from sb3_peer import StableBaselines
    from task import Task

    task = Task("toy-pursuit", {}, "scripted:toy-pursuit/evader/v1", batch=128, num_envs=16, threads=1)
    contestants = sb3, runner = StableBaselines(task, "dummy:2", 1), RslRl(task, 1)
    assert [contestant.iterate() for contestant in contestants] == [128, 128]
    batch = StableBaselines(task, "batch:16", 1)
    assert (batch.iterate(), batch._model.n_steps, batch._model.batch_size) == (128, 8, sb3._model.batch_size)
    batch.close()
    ppo = task.config("adrl").ppo
    theirs, alg = sb3._model, runner._runner.alg
    assert (theirs.n_epochs, alg.num_learning_epochs) == (ppo.epochs, ppo.epochs)
    assert (128 // theirs.batch_size, alg.num_mini_batches) == (ppo.minibatches, ppo.minibatches)
    assert (theirs.learning_rate, alg.learning_rate) == (ppo.learning_rate, ppo.learning_rate)
    assert (theirs.gamma, theirs.gae_lambda, alg.gamma, alg.lam) == (ppo.gamma, ppo.lam, ppo.gamma, ppo.lam)
    assert (theirs.clip_range(1), theirs.clip_range_vf(1), alg.clip_param) == (ppo.clip,) * 3
    assert (theirs.max_grad_norm, alg.max_grad_norm) == (ppo.max_grad_norm, ppo.max_grad_norm)
    assert theirs.vf_coef == alg.value_loss_coef == ppo.value_coefficient / 2
    layers = [*shapes(theirs.policy.mlp_extractor.policy_net), *shapes(theirs.policy.action_net)]
    assert layers == shapes(alg.actor)
    assert [shape[0] for shape in layers[::2]] == [*ppo.hidden, layers[-1][0]]
    for contestant in contestants:
        contestant.close()


def test_a_batch_beside_ours_speed_and_curves(peers, tmp_path):
    pytest.importorskip("stable_baselines3", reason="no stable_baselines3 here")
    from vector import main

    out = tmp_path / "vector.json"
    main(
        [
            *("--speed", "toy-pursuit:", "--rounds", "2", "--num-envs", "8", "--num-steps", "8"),
            *(
                "--seeds",
                "2",
                "--steps",
                "4096",
                "--json",
                str(out),
                "--picture",
                str(tmp_path / "curves.png"),
            ),
        ]
    )
    report = json.loads(out.read_text())
    assert [row["what"] for row in report["speed"]] == ["collection", "training"]
    for row in report["speed"]:
        ratios = [theirs / ours for ours, theirs in zip(row["ours"], row["theirs"], strict=True)]
        assert row["ratio"] == pytest.approx(sum(ratios) / 2)
        assert row["low"] < row["ratio"] < row["high"]
    runs = report["curves"]["runs"]
    assert list(runs) == ["APIL, ADRL", "Stable-Baselines3"]
    for first, second in runs.values():
        assert [point[0] for point in first] == [2048, 4096]
        assert [point[2] for point in first] != [point[2] for point in second]  # seeds differ
        assert all(0 <= point[2] <= 1 for point in first)
    assert (tmp_path / "curves.png").stat().st_size > 1000


def shapes(network) -> list[tuple[int, ...]]:
    """Of weights and biases."""
    return [tuple(p.shape) for name, p in network.named_parameters() if "std" not in name]
