"""Two stand-ins for a run's hook manager: one that times its own work, one that calls directly."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pluggy

from apil_core.api.hooks import hookimpl
from apil_core.api.specs import MethodSpec
from apil_core.api.types import Rollout
from apil_core.plugins.hook_manager import RunHookManager

if TYPE_CHECKING:
    from torch import Tensor

TAPE = "apil bench speed"
"""Name of the tape among the plugins of a measured run."""

Caller = Callable[..., Any]


class Tape:
    """Keeps an iteration's rollout, so that its games can be played again."""

    rollout: Rollout

    @hookimpl
    def update_auxiliary(self, rollout: Rollout) -> None:
        """The rollout is whole here, and its buffers are not reused before the next iteration."""
        self.rollout = rollout


class TimedHooks(RunHookManager):
    """The real thing, plus a clock that runs between a hook's caller and the implementations it reaches.

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
        vars(clocked)["__code__"] = getattr(function, "__code__", None)  # who is to blame for an exception
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


class DirectHooks(RunHookManager):
    """Calls the same implementations as plain functions, without pluggy.

    Who is asked, in which order and with which arguments is settled once; what they return is neither checked
    nor watched for double names.
    """

    def __init__(self, chain: Sequence[MethodSpec], plugins: Mapping[str, Any]):
        super().__init__(chain, plugins)
        self._namespaces: dict[frozenset[int], SimpleNamespace] = {}
        self._direct = self.without(())

    @property
    def hook(self) -> Any:
        """See :class:`RunHookManager`."""
        return self._direct

    def only(self, plugin: Any) -> Any:
        """See :class:`RunHookManager`."""
        return self.without([other for other in self.plugins.values() if other is not plugin])

    def without(self, plugins: Collection[Any]) -> Any:
        """See :class:`RunHookManager`."""
        left_out = frozenset(id(plugin) for plugin in plugins)
        if left_out not in self._namespaces:
            self._namespaces[left_out] = self._namespace(left_out)
        return self._namespaces[left_out]

    def merged(self, answers: Sequence[Mapping[str, Any] | None], hook: str) -> dict[str, Any]:
        """One dict, first registered first."""
        return {name: value for answer in reversed(answers) if answer for name, value in answer.items()}

    def checked(
        self, hook: str, name: str, value: Any, shape: tuple[int, ...], by: str | None = None
    ) -> Tensor:
        """``value`` as it is."""
        return value

    def _namespace(self, left_out: frozenset[int]) -> SimpleNamespace:
        """Direct callers of all hooks, but for plugins of these ids."""
        callers = {}
        for name in vars(self.manager.hook):
            caller = getattr(self.manager.hook, name)
            asked = [i for i in caller.get_hookimpls() if id(i.plugin) not in left_out]
            first = bool(caller.spec and caller.spec.opts["firstresult"])
            callers[name] = direct_caller(asked, first_result=first)
        return SimpleNamespace(**callers)


def direct_caller(implementations: Sequence[pluggy.HookImpl], *, first_result: bool) -> Caller:
    """A function that does what pluggy's caller of these implementations does, settled beforehand.

    Args:
        implementations: in order of registration, wrappers last; called from the last to the first.
        first_result: stop at the first answer that is not ``None`` and return it.
    """
    plain = [_picked(i) for i in reversed(implementations) if not (i.wrapper or i.hookwrapper)]
    call = partial(_first, plain) if first_result else partial(_all, plain)
    for implementation in implementations:
        if implementation.wrapper:
            call = partial(_wrapped, _picked(implementation), call)
        elif implementation.hookwrapper:
            call = partial(_wrapped_old, _picked(implementation), call)
    return call


def _picked(implementation: pluggy.HookImpl) -> Caller:
    """The implementation, to be called with the dict of all arguments the hook was given."""
    function, names, defaulted = implementation.function, implementation.argnames, implementation.kwargnames
    if not defaulted:
        return lambda given: function(*[given[name] for name in names])
    return lambda given: function(
        *[given[name] for name in names], **{name: given[name] for name in defaulted if name in given}
    )


def _all(functions: Sequence[Caller], **arguments: Any) -> list[Any]:
    answers = [function(arguments) for function in functions]
    return [answer for answer in answers if answer is not None]


def _first(functions: Sequence[Caller], **arguments: Any) -> Any:
    for function in functions:
        answer = function(arguments)
        if answer is not None:
            return answer
    return None


def _wrapped(wrapper: Caller, call: Caller, **arguments: Any) -> Any:
    """A wrapper as pluggy 1.2 and later has it: a generator that returns the result."""
    generator = wrapper(arguments)
    next(generator)
    try:
        answer = call(**arguments)
    except BaseException as error:
        return _end(generator.throw, error)
    return _end(generator.send, answer)


def _end(resume: Caller, value: Any) -> Any:
    try:
        resume(value)
    except StopIteration as stop:
        return stop.value
    raise RuntimeError("a hook wrapper has a second yield")


def _wrapped_old(wrapper: Caller, call: Caller, **arguments: Any) -> Any:
    """A ``hookwrapper``: a generator that gets the outcome and may change it."""
    generator = wrapper(arguments)
    next(generator)
    outcome = pluggy.Result.from_call(lambda: call(**arguments))
    _end(generator.send, outcome)
    return outcome.get_result()
