"""What ``update_auxiliary`` hands back is done beside PPO's update; the bits are those of doing it first."""

from __future__ import annotations

import threading
import time

import pytest
import torch
from helpers.made_plugins import registry_with
from helpers.small_runs import differences, final_state, metrics_of, small_config

from apil_core import Method, PluginError, hookimpl, run
from apil_core.common.torch_threads import side_by_side
from apil_core.training import trainer as trainer_module


class Later(Method):
    """Hands its work back; ``work`` is replaced by tests."""

    threads: set = set()

    @hookimpl
    def update_auxiliary(self, run, rollout):
        return lambda: self.work(run, rollout)

    def work(self, run, rollout):
        self.threads.add(threading.get_ident())
        return {"drawn": torch.rand(1, generator=run.generator)}


def train(tmp_path, monkeypatch, name, *, cores, method="later", made=Later, **changes):
    monkeypatch.setattr(trainer_module, "usable_cpus", lambda: cores)
    registry = registry_with(made, name="later", requires=())
    run(small_config(method, threads=cores, **changes), out=tmp_path / name, plugins=registry)
    return tmp_path / name


@pytest.mark.parametrize(
    ("method", "options"),
    [
        ("e_apil", {}),
        ("e_apil", {"apil": {"rollouts": "own", "imitator": {"objective": "both", "update": "ppo"}}}),
        ("later", {}),
    ],
)
def test_one_core_and_two_give_the_same_bits(tmp_path, monkeypatch, method, options):
    runs = [
        train(tmp_path, monkeypatch, f"{cores}", cores=cores, method=method, options=options)
        for cores in (1, 2)
    ]
    assert differences(*map(final_state, runs)) == []


def test_two_cores_are_used_where_there_are_two(tmp_path, monkeypatch):
    for cores, other_thread in ((1, False), (2, True)):
        Later.threads = set()
        path = train(tmp_path, monkeypatch, f"{cores}", cores=cores)
        assert (threading.get_ident() not in Later.threads) == other_thread
        assert 0 < metrics_of(path)[-1]["later/drawn"] < 1


def changing(self, run, rollout):
    rollout.reward.add_(1.0)


def collecting(self, run, rollout):
    run.collect(None, 1)


def failing(self, run, rollout):
    raise ValueError("no")


@pytest.mark.parametrize("cores", [1, 2])
@pytest.mark.parametrize(
    ("work", "message"),
    [
        (changing, r"update_auxiliary \(filled by later\): changed rollout.reward in place"),
        (collecting, "call it before update_auxiliary returns"),
        (failing, "plugin 'later' failed in update_auxiliary: ValueError: no"),
        (lambda self, run, rollout: {"x": "y"}, "plugin 'later': update_auxiliary: 'x' must be a number"),
        (lambda self, run, rollout: 3, "must return a dict or None, got int"),
    ],
)
def test_what_goes_wrong_there_is_told(tmp_path, monkeypatch, cores, work, message):
    made = type("Bad", (Later,), {"work": work})
    with pytest.raises(PluginError, match=message):
        train(tmp_path, monkeypatch, "r", cores=cores, made=made)


def test_the_thread_beside_has_one_torch_thread_too():
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        assert side_by_side(torch.get_num_threads, torch.get_num_threads, apart=True) == (1, 1)
    finally:
        torch.set_num_threads(before)


def test_an_error_here_waits_for_the_work_there():
    failed, ended = threading.Event(), []

    def work():
        failed.wait(10)
        time.sleep(0.05)
        ended.append(True)

    def fail():
        failed.set()
        raise KeyError("here")

    with pytest.raises(KeyError):
        side_by_side(work, fail, apart=True)
    assert ended == [True]


@pytest.mark.parametrize("apart", [False, True])
def test_of_two_errors_the_first_functions_is_raised(apart):
    def fail(error):
        raise error

    with pytest.raises(ValueError, match="first"):
        side_by_side(lambda: fail(ValueError("first")), lambda: fail(KeyError("second")), apart=apart)
