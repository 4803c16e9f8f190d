"""Filters follow one another, required methods first, and every mistake has its plugin's name."""

from __future__ import annotations

import re

import pytest
import torch

from apil_core import Context, PluginError, SideLayout, hookimpl
from apil_core.plugins.hook_manager import RunHookManager
from apil_core.training.observation_filter import ObservationFilter

SHAPE = (4, 3)


def manager(**filters):
    def plugin(function):
        return type("Plugin", (), {"filter_observation": staticmethod(hookimpl(function))})()

    return RunHookManager((), {name: plugin(function) for name, function in filters.items()})


def filtered(hooks, side=0):
    device = torch.device("cpu")
    seat = SideLayout("player", observation_size=SHAPE[1], action_size=1, action_low=-1.0, action_high=1.0)
    contexts = {
        i: Context(i, ("adversary", "victim")[i], seat, "eval", device, torch.Generator()) for i in (0, 1)
    }
    return ObservationFilter(hooks, contexts)(side, torch.ones(SHAPE))


def test_each_gets_what_the_last_one_returned():
    hooks = manager(doubled=lambda obs: 2 * obs, nothing=lambda side: None, more=lambda obs, context: obs + 1)
    assert torch.equal(filtered(hooks), torch.full(SHAPE, 3.0))
    hooks = manager(more=lambda obs: obs + 1, doubled=lambda obs: 2 * obs)
    assert torch.equal(filtered(hooks), torch.full(SHAPE, 4.0))


def test_a_filter_may_leave_a_side_alone():
    hooks = manager(one=lambda obs, side: None if side == 0 else 0 * obs, two=lambda obs: obs + 1)
    assert torch.equal(filtered(hooks, 0), torch.full(SHAPE, 2.0))
    assert torch.equal(filtered(hooks, 1), torch.ones(SHAPE))


def test_without_filters_the_observation_is_handed_through():
    observation = torch.ones(SHAPE)
    for hooks in (None, manager()):
        assert ObservationFilter(hooks, {})(0, observation) is observation


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (lambda obs: obs[1:], "must return (4, 3) float32, got (3, 3) float32"),
        (lambda obs: obs.double(), "must return (4, 3) float32, got (4, 3) float64"),
        (lambda obs: obs / 0, "must return finite, got NaN or infinite values"),
        (lambda obs: 7, "must return a tensor (4, 3) float32, got 7"),
    ],
)
def test_only_the_culprit_is_named(answer, message):
    hooks = manager(good=lambda obs: obs, bad=answer, better=lambda obs: obs)
    with pytest.raises(PluginError, match=re.escape(f"filter_observation (filled by bad): {message}")):
        filtered(hooks)


def test_a_crash_is_put_down_to_its_plugin():
    def crash(obs):
        raise ValueError("no")

    hooks = manager(good=lambda obs: obs, bad=crash)
    with (
        pytest.raises(PluginError, match="plugin 'bad' failed in filter_observation: ValueError: no"),
        hooks.attribution(),
    ):
        filtered(hooks)


def test_there_is_nothing_to_wrap():
    class Wrapper:
        @hookimpl(wrapper=True)
        def filter_observation(self, obs):
            result = yield
            return result

    with pytest.raises(PluginError, match="plugin 'wrap' cannot be used: filter_observation cannot be wr"):
        filtered(RunHookManager((), {"wrap": Wrapper()}))
