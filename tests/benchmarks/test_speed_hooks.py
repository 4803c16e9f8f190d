"""Timed hooks, as the speed benchmark calls them, change nothing."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest
import torch
from helpers.small_runs import differences, small_config

from apil_core.api.hooks import hookimpl
from apil_core.common.errors import PluginError
from apil_core.plugins.hook_manager import RunHookManager
from apil_core.plugins.registry import default_plugins
from speed.hooks import TAPE, TimedHooks
from speed.training import TimedTraining


def state_of(training: TimedTraining) -> dict[str, Any]:
    """All of a training, as it would be written to a checkpoint."""
    state = copy.deepcopy(training.trainer.state_dict()) | {"torch_rng": training._generator}
    return tensors(state)


def tensors(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: tensors(item) for key, item in value.items()}
    return torch.from_numpy(value) if isinstance(value, np.ndarray) else value


def trained(manager: type[RunHookManager], method: str) -> tuple[dict[str, Any], TimedTraining]:
    training = TimedTraining(small_config(method), default_plugins(), manager)
    for _ in range(2):
        training.iterate()
    return state_of(training), training


@pytest.mark.parametrize("method", ["adrl", "apl", "e_apil"])
def test_timed_hooks_train_bit_for_bit_the_same(method: str) -> None:
    real, _ = trained(RunHookManager, method)
    timed, training = trained(TimedHooks, method)
    assert differences(real, timed) == []
    hooks = training.timed_hooks
    # extend_observation: 1 before the first step, then 16 a rollout
    assert hooks.calls >= 1 + 2 * 16
    assert 0 < hooks.seconds < training.trainer.wall_seconds
    assert hooks.tape.rollout.action.shape == (16, 32, 2)


def test_trainings_in_one_process_do_not_disturb_each_other() -> None:
    alone, _ = trained(TimedHooks, "e_apil")
    pair = [
        TimedTraining(small_config("e_apil"), default_plugins(), kind)
        for kind in (TimedHooks, RunHookManager)
    ]
    for _ in range(2):
        for training in pair:
            training.iterate()
    for training in pair:
        assert differences(alone, state_of(training)) == []


class Breaks:
    @hookimpl
    def shape_reward(self, run, step):
        raise RuntimeError("oh no")


def test_who_is_to_blame_is_still_known() -> None:
    hooks = TimedHooks([], {"breaks": Breaks()})
    with (
        pytest.raises(PluginError, match="plugin 'breaks' failed in shape_reward: RuntimeError: oh no"),
        hooks.attribution(),
    ):
        hooks.hook.shape_reward(run=None, step=None)


class Bonus:
    def __init__(self, value: float):
        self.value = value

    @hookimpl
    def shape_reward(self, step):
        return {f"bonus {self.value}": self.value}


@pytest.mark.parametrize("manager", [RunHookManager, TimedHooks])
def test_plugins_can_be_asked_alone_or_left_out(manager: type[RunHookManager]) -> None:
    first, second = Bonus(1.0), Bonus(2.0)
    hooks = manager([], {"first": first, "second": second})

    def asked(caller: Any) -> dict[str, float]:
        return hooks.merged(caller.shape_reward(run=None, step=None), "shape_reward")

    assert list(asked(hooks.hook)) == ["bonus 1.0", "bonus 2.0"]
    assert asked(hooks.only(second)) == asked(hooks.without([first])) == {"bonus 2.0": 2.0}
    assert hooks.implements("shape_reward")
    assert (TAPE in hooks.plugins) == (manager is TimedHooks)
