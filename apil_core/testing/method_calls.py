"""Checks of the recorded hook calls: their order and their cost."""

from __future__ import annotations

import statistics
from itertools import zip_longest

from apil_core.api.hookspecs import RunHooks
from apil_core.plugins.hook_manager import RunHookManager
from apil_core.testing.checks import checking
from apil_core.testing.hook_spy import Call
from apil_core.testing.method_runs import WatchedRun
from apil_core.testing.method_under_test import MethodUnderTest
from apil_core.testing.reports import HookCost

_PER_STEP = ("filter_observation", "extend_observation", "shape_reward")
_PER_ROLLOUT = (
    "relabel_reward",
    "finish_rollout",
    "combine_advantages",
    "update_auxiliary",
    "iteration_finished",
)


@checking("calls")
def check_calls(tested: MethodUnderTest, run: WatchedRun) -> None:
    """Check the order of the calls, and that every hook that the method implements is called."""
    calls = run.spy.calls
    hooks = run.trainer.attack.hooks
    called = {call.hook for call in calls if tested.name in call.plugins}
    for caller in hooks.manager.get_hookcallers(run.trainer.attack.methods[tested.name]) or []:
        optional = not hasattr(RunHooks, caller.name) and tested.options  # another method's, switched off
        text = f"{caller.name} is filled but was never called"
        tested.need(caller.name in called or optional, text, caller.name)
    expected = expected_calls(
        {name: _fillers(hooks, name) for name in vars(RunHooks) if not name.startswith("_")},
        rollouts=run.trainer.iteration,
        steps=run.config.ppo.num_steps,
    )
    made = [_event(call) for call in calls if not call.within and hasattr(RunHooks, call.hook)]
    for number, (came, wanted) in enumerate(zip_longest(made, expected, fillvalue="none"), 1):
        tested.need(came == wanted, f"call {number} of the run was {came}, expected was {wanted}")


def _fillers(hooks: RunHookManager, name: str) -> list[str]:
    impls = getattr(hooks.manager.hook, name).get_hookimpls()
    filling = {impl.plugin_name for impl in impls}
    return [plugin for plugin in hooks.plugins if plugin in filling]


def _event(call: Call) -> str:
    if call.hook in ("filter_observation", "relabel_reward", "update_auxiliary"):  # called one by one
        return f"{call.hook} of {call.plugins[0]}"
    return call.hook


def expected_calls(fillers: dict[str, list[str]], *, rollouts: int, steps: int) -> list[str]:
    """The calls that docs/hooks.md documents for a run that is evaluated at its end, in order.

    Args:
        fillers: plugins that implement each core hook, required methods first.
        rollouts: iterations of the run.
        steps: vectorised steps of each.
    """

    def some(hook: str) -> list[str]:
        return [hook] if fillers.get(hook) else []

    def each(hook: str) -> list[str]:
        return [f"{hook} of {plugin}" for plugin in fillers.get(hook, [])]

    observe = 2 * each("filter_observation") + some("extend_observation")
    rollout = steps * (some("shape_reward") + observe)
    rollout += each("relabel_reward") + some("finish_rollout") + some("combine_advantages")
    rollout += each("update_auxiliary") + some("iteration_finished")
    end = some("evaluation_finished") + some("run_finished")
    return observe + some("run_started") + rollouts * rollout + end


def costs(tested: MethodUnderTest, run: WatchedRun) -> tuple[list[HookCost], float]:
    """Time of the recorded run's hooks: a row per hook, and seconds per vectorised step in total."""
    mine = [call for call in run.spy.calls if tested.name in call.plugins]
    rows = []
    for hook in dict.fromkeys(call.hook for call in mine):
        times = [call.seconds for call in mine if call.hook == hook]
        every = "step" if hook in _PER_STEP else "rollout"
        if hook not in (*_PER_STEP, *_PER_ROLLOUT):
            every = "run" if hasattr(RunHooks, hook) else "rollout"
        rows.append(HookCost(hook, len(times), every, statistics.median(times)))
    steps = run.trainer.iteration * run.config.ppo.num_steps
    typical = {row.hook: row.seconds for row in rows if row.every != "run"}
    outer = (call for call in mine if tested.name not in call.within)
    return rows, sum(typical.get(call.hook, 0.0) for call in outer) / steps
