"""Hooks as ``apil bench speed`` calls them: timed, and directly; both must change nothing."""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pluggy
import pytest
import torch
from helpers.small_runs import differences, small_config

from apil_core.api.hooks import hookimpl
from apil_core.common.errors import PluginError
from apil_core.plugins.hook_manager import RunHookManager
from apil_core.plugins.registry import default_plugins
from apil_core.studies.speed.contestant import Contestant
from apil_core.studies.speed.hooks import TAPE, DirectHooks, TimedHooks, direct_caller

spec = pluggy.HookspecMarker("many")
impl = pluggy.HookimplMarker("many")


class Specs:
    @spec
    def collect(self, a, b):
        """All answers."""

    @spec(firstresult=True)
    def decide(self, a, b):
        """The first answer."""


def plugin(log: list[Any], name: str, answer: Any, **options: Any) -> Any:
    """Fills both hooks with plain functions, of different arguments."""

    class Plugin:
        @impl(**options)
        def collect(self, b, a=7):
            log.append((name, a, b))
            return answer

        @impl(**options)
        def decide(self, a):
            log.append((name, a))
            return answer

    return Plugin()


def wrapping(log: list[Any], name: str) -> Any:
    class Wrapper:
        @impl(wrapper=True)
        def collect(self, a):
            log.append((name, "in", a))
            result = yield
            log.append((name, "out"))
            return [*result, name]

        @impl(wrapper=True)
        def decide(self):
            try:
                return (yield), name
            except ValueError as error:
                return f"{name} caught {error}"

    return Wrapper()


def old_wrapping(log: list[Any], name: str) -> Any:
    class Wrapper:
        @impl(hookwrapper=True)
        def collect(self, b):
            outcome = yield
            log.append((name, b, outcome.get_result()))
            outcome.force_result([name])

        @impl(hookwrapper=True)
        def decide(self):
            outcome = yield
            log.append(name)
            outcome.force_result((outcome.get_result(), name))

    return Wrapper()


def failing(log: list[Any]) -> Any:
    class Failing:
        @impl(tryfirst=True)
        def decide(self):
            raise ValueError("no")

    return Failing()


def none_of_it(log: list[Any]) -> list[Any]:
    return []


def several(log: list[Any]) -> list[Any]:
    return [plugin(log, "x", 1), plugin(log, "y", None), plugin(log, "z", 3)]


def ordered(log: list[Any]) -> list[Any]:
    return [plugin(log, "x", 1, tryfirst=True), plugin(log, "y", 2), plugin(log, "z", 3, trylast=True)]


def wrapped(log: list[Any]) -> list[Any]:
    return [wrapping(log, "u"), *several(log), old_wrapping(log, "v"), wrapping(log, "w")]


def failed(log: list[Any]) -> list[Any]:
    return [wrapping(log, "u"), failing(log), plugin(log, "x", 1)]


@pytest.mark.parametrize("make", [none_of_it, several, ordered, wrapped, failed])
@pytest.mark.parametrize("hook", ["collect", "decide"])
def test_a_direct_caller_does_what_pluggy_does(make: Callable[[list[Any]], Sequence[Any]], hook: str) -> None:
    log: list[Any] = []
    manager = pluggy.PluginManager("many")
    manager.add_hookspecs(Specs)
    for each in make(log):
        manager.register(each)
    caller = getattr(manager.hook, hook)
    expected = caller(a=1, b=2), tuple(log)
    log.clear()
    direct = direct_caller(caller.get_hookimpls(), first_result=hook == "decide")
    assert (direct(a=1, b=2), tuple(log)) == expected


def state_of(contestant: Contestant) -> dict[str, Any]:
    """All of a training, as it would be written to a checkpoint."""
    state = copy.deepcopy(contestant.trainer.state_dict()) | {"torch_rng": contestant._generator}
    return tensors(state)


def tensors(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: tensors(item) for key, item in value.items()}
    return torch.from_numpy(value) if isinstance(value, np.ndarray) else value


def trained(manager: type[RunHookManager], method: str) -> tuple[dict[str, Any], Contestant]:
    contestant = Contestant(small_config(method), default_plugins(), manager)
    for _ in range(2):
        contestant.iterate()
    return state_of(contestant), contestant


@pytest.mark.parametrize("method", ["adrl", "apl", "e_apil"])
def test_timed_and_direct_hooks_train_bit_for_bit_the_same(method: str) -> None:
    real, _ = trained(RunHookManager, method)
    timed, contestant = trained(TimedHooks, method)
    direct, _ = trained(DirectHooks, method)
    assert differences(real, timed) == []
    assert differences(real, direct) == []
    hooks = contestant.timed_hooks
    # extend_observation: 1 before the first step, then 16 a rollout
    assert hooks.calls >= 1 + 2 * 16
    assert 0 < hooks.seconds < contestant.trainer.wall_seconds
    assert hooks.tape.rollout.action.shape == (16, 32, 2)


def test_trainings_in_one_process_do_not_disturb_each_other() -> None:
    alone, _ = trained(TimedHooks, "e_apil")
    pair = [Contestant(small_config("e_apil"), default_plugins(), kind) for kind in (TimedHooks, DirectHooks)]
    for _ in range(2):
        for contestant in pair:
            contestant.iterate()
    for contestant in pair:
        assert differences(alone, state_of(contestant)) == []


def test_one_training_goes_on_where_another_stands() -> None:
    state, leader = trained(TimedHooks, "e_apil")
    follower = Contestant(small_config("e_apil"), default_plugins(), DirectHooks)
    follower.follow(leader)
    for contestant in (leader, follower):
        contestant.iterate()
    assert differences(state_of(leader), state_of(follower)) == []
    assert differences(state_of(leader), state) != []


class Breaks:
    @hookimpl
    def shape_reward(self, run, step):
        raise RuntimeError("oh no")


@pytest.mark.parametrize("manager", [TimedHooks, DirectHooks])
def test_who_is_to_blame_is_still_known(manager: type[RunHookManager]) -> None:
    hooks = manager([], {"breaks": Breaks()})
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


@pytest.mark.parametrize("manager", [RunHookManager, TimedHooks, DirectHooks])
def test_plugins_can_be_asked_alone_or_left_out(manager: type[RunHookManager]) -> None:
    first, second = Bonus(1.0), Bonus(2.0)
    hooks = manager([], {"first": first, "second": second})

    def asked(caller: Any) -> dict[str, float]:
        return hooks.merged(caller.shape_reward(run=None, step=None), "shape_reward")

    assert list(asked(hooks.hook)) == ["bonus 1.0", "bonus 2.0"]
    assert asked(hooks.only(second)) == asked(hooks.without([first])) == {"bonus 2.0": 2.0}
    assert hooks.fills("shape_reward")
    assert (TAPE in hooks.plugins) == (manager is TimedHooks)
