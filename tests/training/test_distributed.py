"""Two real processes, started by torchrun, train as one and go on as one; statistics are pooled exactly."""

from __future__ import annotations

import json
import signal

import numpy as np
import pytest
import torch
from helpers.small_runs import differences, leaves, metrics_of, small_config

from apil_core import ConfigError, RunDirError, evaluate, resume
from apil_core.config.resolve import dump_yaml
from apil_core.training.distributed.moments import pooled
from apil_core.training.distributed.replicas import averaged, parts
from apil_core.training.distributed.world import World
from apil_core.training.normalize import ObservationNormalizer, ReturnNormalizer, RunningMoments
from apil_core.training.storage import checkpoint
from apil_core.training.storage.metrics_log import over_processes
from apil_core.training.storage.run_dir import RunDir, part_of_rank
from training.test_resume import wait_for_checkpoint
from training.together import torchrun, train

ITERATIONS = 4
LONG = 20
"""Iterations of a run that is stopped on its way."""
STEPS = 2 * 32 * 16
"""Of both processes in an iteration."""
CHANGES = {
    "steps": ITERATIONS * STEPS,
    "checkpoint": {"every_iterations": 1, "keep": 3},
    "evaluation": {"episodes": 8, "every_steps": STEPS, "periodic_episodes": 4},
}
NOTE = """
import os
from pathlib import Path
from apil_core import Method, MethodSpec, hookimpl

def note(metrics):
    with Path(__file__).with_suffix("." + os.environ["RANK"]).open("a") as file:
        print(metrics["games_total"], metrics["evaluation/win"], file=file)
"""
LISTENER = """
class Listener(Method):
    @hookimpl
    def iteration_finished(self, metrics):
        note(metrics)

@hookimpl
def register_methods():
    return [MethodSpec("listener", __name__ + ":Listener")]
"""
OBSERVER = """
@hookimpl
def iteration_finished(metrics):
    note(metrics)
"""
OPTIONS = {
    "adrl": {},
    "apl": {"apl": {"advantage_difference": True}},
    "e_apil": {},
    "apil": {"apil": {"rollouts": "own", "imitator": {"update": "ppo"}}},
}


def write(folder, name, config):
    (folder / f"{name}.yaml").write_text(dump_yaml(config))


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """One run of two processes per method, and what they printed."""
    folder = tmp_path_factory.mktemp("together")
    for method, options in OPTIONS.items():
        write(folder, method, small_config(method, options=options, **CHANGES))
    for name, text in (("listener", LISTENER), ("observer", OBSERVER)):
        (folder / f"{name}.py").write_text(NOTE + text)
    plugins = (str(folder / "listener.py"), str(folder / "observer.py"))
    config = small_config("listener", plugins=plugins, observers=("observer",), **CHANGES)
    write(folder, "heard", config)
    return folder, train(folder, *OPTIONS, "heard")


def both(path):
    return [checkpoint.read(part_of_rank(path, rank)) for rank in (0, 1)]


def shared(state):
    """What all processes must agree on: everything but the games and what belongs to single ones."""
    keys = ("iteration", "steps", "processes", "builder", "learner", "methods")
    agreed = {key: state[key] for key in keys} | {"normalizers": state["env"]["normalizers"]}
    return {path: value for path, value in leaves(agreed) if not path.endswith("/returns")}


@pytest.mark.parametrize("method", OPTIONS)
def test_both_processes_learn_the_same_from_games_of_their_own(trained, method):
    paths = RunDir(trained[0] / method).checkpoints()
    assert len(paths) >= 2
    for path in paths:
        first, second = both(path)
        assert differences(shared(first), shared(second)) == []
        assert not torch.equal(first["env"]["game"]["position"], second["env"]["game"]["position"])
        assert not torch.equal(first["torch_rng"], second["torch_rng"])
        assert not torch.equal(first["generators"]["victim"], second["generators"]["victim"])


@pytest.mark.parametrize("method", OPTIONS)
def test_statistics_are_those_of_all_games(trained, method):
    state = both(RunDir(trained[0] / method).newest_checkpoint())[0]
    # each process's observations of every step, and the first ones
    count = float(state["builder"]["normalizers.own.moments.count"])
    assert count == 32 * (16 * state["iteration"] + 1)
    assert torch.equal(
        state["builder"]["normalizers.own.shift"],
        state["builder"]["normalizers.own.moments.mean"].float(),
    )


def test_metrics_and_evaluations_are_told_once_and_for_all(trained):
    folder, output = trained
    rows = metrics_of(folder / "adrl")
    assert [row["steps"] for row in rows] == [STEPS * (i + 1) for i in range(ITERATIONS)]
    stats = [state["env"]["stats"] for state in both(RunDir(folder / "adrl").newest_checkpoint())]
    assert rows[-1]["games_total"] == sum(part["games_total"] for part in stats)
    assert rows[-1]["window_games"] == sum(len(part["window"]) for part in stats)
    assert sum(row["games"] for row in rows) == rows[-1]["games_total"]
    assert all(row["evaluation/episodes"] == 4 for row in rows)
    result = RunDir(folder / "adrl").result()
    assert (result["status"], result["steps"]) == ("finished", ITERATIONS * STEPS)
    assert result["evaluation"]["trained_steps"] == ITERATIONS * STEPS
    environment = json.loads(RunDir(folder / "adrl").environment_path.read_text())
    assert [session["processes"] for session in environment] == [2]
    # once for all processes, and nothing else
    assert all(line.startswith("apil: loads code: ") for line in output.splitlines() if "apil" in line)
    assert output.count("apil: loads code: ") == 2


def test_steps_of_side_games_count_in_all_processes(trained):
    rows = metrics_of(trained[0] / "apil")
    assert [row["steps"] for row in rows] == [2 * STEPS, 4 * STEPS]


def test_methods_hear_of_an_iteration_in_every_process_observers_in_the_first(trained):
    folder = trained[0]
    first, second = ((folder / f"listener.{rank}").read_text() for rank in (0, 1))
    assert first == second == (folder / "observer.0").read_text()
    assert len(first.splitlines()) == ITERATIONS
    assert not (folder / "observer.1").exists()


def test_only_the_newest_parts_stay(trained):
    names = {path.name for path in RunDir(trained[0] / "e_apil").checkpoint_dir.iterdir()}
    kept = {f"iteration-{i:08d}.pt" for i in (2, 3, 4)}
    assert names == {"best.pt"} | kept | {f"{name}.rank1" for name in kept}


def test_the_best_of_several_processes_can_be_scored(trained):
    assert evaluate(trained[0] / "e_apil", checkpoint_path="best", episodes=4).trained_steps


def test_another_number_of_processes_is_refused(trained):
    with pytest.raises(
        RunDirError, match="of a run of 2 processes, here are 1; continue it with: torchrun"
    ) as e:
        resume(trained[0] / "e_apil", steps=100 * STEPS)
    assert "\n" not in str(e.value)


@pytest.mark.slow
def test_stopped_and_resumed_equals_running_through(tmp_path):
    config = small_config(steps=LONG * STEPS, checkpoint={"every_iterations": 1})
    write(tmp_path, "whole", config)
    write(tmp_path, "stopped", config)
    stopped = tmp_path / "stopped"
    process = torchrun(
        *("apil_core.cli", "run", "--config", tmp_path / "stopped.yaml", "--out", stopped), module=True
    )
    wait_for_checkpoint(process, stopped, count=1)
    process.send_signal(signal.SIGTERM)
    output, _ = process.communicate(timeout=60)
    assert output.count("-m apil_core.cli resume") == 1, output
    assert RunDir(stopped).result()["status"] == "interrupted"
    path = RunDir(stopped).newest_checkpoint()
    assert both(path)[0]["iteration"] == both(path)[1]["iteration"] < LONG
    train(tmp_path, "stopped", "whole")
    for left, right in zip(
        *(both(RunDir(tmp_path / name).newest_checkpoint()) for name in ("stopped", "whole")), strict=True
    ):
        assert left["iteration"] == LONG
        assert differences(left, right) == []
    assert [row["iteration"] for row in metrics_of(stopped)] == list(range(1, LONG + 1))


FAILING = """
import os
from apil_core import hookimpl

@hookimpl
def update_auxiliary(run):
    if run.iteration == 1 and os.environ["RANK"] == "{rank}":
        raise ValueError("out of luck")
"""


@pytest.mark.parametrize("rank", [pytest.param(rank, marks=pytest.mark.slow) for rank in (0, 1)])
def test_an_error_in_one_process_ends_the_other(tmp_path, rank):
    plugin = tmp_path / "unlucky.py"
    plugin.write_text(FAILING.format(rank=rank))
    config = small_config("adrl", steps=10_000 * STEPS, plugins=(str(plugin),), observers=("unlucky",))
    write(tmp_path, "r", config)
    process = torchrun(
        "apil_core.cli", "run", "--config", tmp_path / "r.yaml", "--out", tmp_path / "r", module=True
    )
    output, _ = process.communicate(timeout=60)
    assert process.returncode != 0
    said = [line for line in output.splitlines() if line.startswith("apil: ")]
    who = "rank 1: " if rank else ""
    assert any(line.startswith(f"apil: {who}plugin 'unlucky' failed in update_auxiliary") for line in said), (
        output
    )
    assert len(said) <= 2, output
    assert "unexpected" not in output
    assert RunDir(tmp_path / "r").result()["status"] == "failed"


def test_pooling_by_hand():
    # process 0 has seen 1, 2, 3; process 1 has seen 7: together mean 13/4, variance (1+4+9+49)/4 − (13/4)²
    mean, var, count = pooled(
        torch.tensor([[2.0], [7.0]], dtype=torch.float64),
        torch.tensor([[2 / 3], [0.0]], dtype=torch.float64),
        torch.tensor([3.0, 1.0], dtype=torch.float64),
    )
    assert mean.item() == pytest.approx(13 / 4)
    assert var.item() == pytest.approx(63 / 4 - (13 / 4) ** 2)
    assert count.item() == 2  # each process stands for half of the four samples


def test_pooling_again_and_again_is_exact():
    rng = np.random.default_rng(0)
    apart = [RunningMoments(3) for _ in range(3)]
    together = RunningMoments(3)
    for _ in range(4):
        for i, moments in enumerate(apart):
            rows = torch.from_numpy(rng.normal(i, i + 1, (5 + i, 3)))
            moments.update(rows)
            together.update(rows)
        ours = pooled(*(torch.stack([getattr(m, name) for m in apart]) for name in ("mean", "var", "count")))
        for moments in apart:
            for mine, new in zip((moments.mean, moments.var, moments.count), ours, strict=True):
                mine.copy_(new)
    torch.testing.assert_close(apart[0].mean, together.mean)
    torch.testing.assert_close(apart[0].var, together.var)
    assert 3 * apart[0].count == together.count


def test_merging_metrics_by_hand():
    rows = [
        {"games": 1, "cause/goal": 1, "window_wins": 2, "return/victim": 4.0, "ppo/kl": 0.1},
        {"games": 3, "cause/goal": 2, "window_wins": 5, "return/victim": 8.0, "ppo/kl": 0.3, "x/y": 1.0},
        {"games": 0, "cause/goal": 0, "window_wins": 0, "ppo/kl": 0.2},
    ]
    assert over_processes(rows) == pytest.approx(
        {"games": 4, "cause/goal": 3, "window_wins": 7, "return/victim": 7.0, "ppo/kl": 0.2, "x/y": 1.0}
    )


class Holder:
    """Networks as plugins may hold them."""

    def __init__(self):
        self.network = torch.nn.Linear(2, 3)
        self.ensemble = [torch.nn.Linear(1, 1), {"last": torch.nn.BatchNorm1d(2)}]
        self.network.optimizer = torch.optim.Adam(self.network.parameters())
        self.same = self.network
        self.scale = ReturnNormalizer(4, 0.99)
        self.normalizer = ObservationNormalizer(5)
        self.hidden = torch.zeros(4, 7)


def test_what_is_averaged():
    holder = Holder()
    holder.network(torch.ones(1, 2)).sum().backward()
    holder.network.optimizer.step()
    shapes = [tuple(tensor.shape) for tensor in averaged(parts(vars(holder)))]
    linear, small, norm = [(3, 2), (3,)], [(1, 1), (1,)], [(2,)] * 4
    adam = [(), (3, 2), (3, 2), (), (3,), (3,)]
    assert shapes == linear + adam + small + norm
    moments = [part for part in parts(vars(holder)) if isinstance(part, RunningMoments)]
    assert moments == [holder.scale.moments, holder.normalizer.moments]


def test_who_one_is(monkeypatch):
    for name in ("RANK", "WORLD_SIZE", "LOCAL_RANK", "LOCAL_WORLD_SIZE"):
        monkeypatch.delenv(name, raising=False)
    assert World.here() == World(0, 1, 0, 1)
    for name, value in {"RANK": "3", "WORLD_SIZE": "4", "LOCAL_RANK": "1", "LOCAL_WORLD_SIZE": "2"}.items():
        monkeypatch.setenv(name, value)
    here = World.here()
    assert here == World(3, 4, 1, 2)
    assert here.seed(0) not in (0, World(2, 4).seed(0))
    assert World(0, 4).seed(5) == 5
    monkeypatch.setattr("os.cpu_count", lambda: 8)
    assert (here.threads(0), here.threads(3), World().threads(0)) == (4, 3, 0)
    with pytest.raises(ConfigError, match="start one process per GPU"):
        here.device("cuda")
    monkeypatch.setenv("RANK", "4")
    with pytest.raises(ConfigError, match="RANK 4 of WORLD_SIZE 4"):
        World.here()
