"""A hook manager that times its own overhead."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

from apil_core.api.hooks import hookimpl
from apil_core.api.specs import MethodSpec
from apil_core.api.types import Rollout
from apil_core.plugins.hook_manager import RunHookManager

if TYPE_CHECKING:
    from torch import Tensor

TAPE = "speed benchmark"
"""Name of the tape among the plugins of a measured run."""

Caller = Callable[..., Any]


class Tape:
    """Keeps an iteration's rollout, so that its games can be replayed."""

    rollout: Rollout

    @hookimpl
    def update_auxiliary(self, rollout: Rollout) -> None:
        """Store the rollout, which is complete here; its buffers are not reused before the next iteration."""
        self.rollout = rollout


class TimedHooks(RunHookManager):
    """The real hook manager, with a clock between a hook's caller and its implementations.

    Attributes:
        calls: hook calls so far.
        seconds: spent so far in dispatch, in merging and in checking of what plugins returned, not in the
            plugins. The clock itself (some 0.2 µs a call) and the bodies of wrappers are counted in.
        tape: a further plugin of the run.
    """

    def __init__(self, chain: Sequence[MethodSpec], plugins: Mapping[str, Any]):
        self.calls = 0
        self.seconds = 0.0
        self.tape = Tape()
        super().__init__(chain, {**plugins, TAPE: self.tape})
        callers = {name: getattr(self.manager.hook, name) for name in vars(self.manager.hook)}
        for caller in callers.values():
            for implementation in caller.get_hookimpls():
                implementation.function = self._clocked(implementation.function)
        self._timed = SimpleNamespace(**{name: partial(self._outside, c) for name, c in callers.items()})

    @property
    def hook(self) -> Any:
        """See :class:`RunHookManager`."""
        return self._timed

    def only(self, plugin: Any) -> Any:
        """See :class:`RunHookManager`."""
        return _TimedSubset(self, self._outside_of_calls(super().only, plugin))

    def without(self, plugins: Collection[Any]) -> Any:
        """See :class:`RunHookManager`."""
        return _TimedSubset(self, self._outside_of_calls(super().without, plugins))

    def merged(self, answers: Sequence[Mapping[str, Any] | None], hook: str) -> dict[str, Any]:
        """See :class:`RunHookManager`."""
        return self._outside_of_calls(super().merged, answers, hook)

    def checked(
        self, hook: str, name: str, value: Any, shape: tuple[int, ...], by: str | None = None
    ) -> Tensor:
        """See :class:`RunHookManager`."""
        return self._outside_of_calls(super().checked, hook, name, value, shape, by)

    def _outside(self, caller: Caller, **arguments: Any) -> Any:
        self.calls += 1
        return self._outside_of_calls(caller, **arguments)

    def _outside_of_calls(self, function: Caller, *arguments: Any, **keywords: Any) -> Any:
        begin = time.perf_counter()
        try:
            return function(*arguments, **keywords)
        finally:
            self.seconds += time.perf_counter() - begin

    def _clocked(self, function: Caller) -> Caller:
        clocked = partial(self._inside, function)
        vars(clocked)["__code__"] = getattr(function, "__code__", None)  # attributes exceptions
        return clocked

    def _inside(self, implementation: Caller, *arguments: Any, **keywords: Any) -> Any:
        begin = time.perf_counter()
        try:
            return implementation(*arguments, **keywords)
        finally:
            self.seconds -= time.perf_counter() - begin


class _TimedSubset:
    def __init__(self, hooks: TimedHooks, subset: Any):
        self._hooks = hooks
        self._subset = subset

    def __getattr__(self, name: str) -> Caller:
        caller = self._hooks._outside_of_calls(getattr, self._subset, name)
        return partial(self._hooks._outside, caller)
