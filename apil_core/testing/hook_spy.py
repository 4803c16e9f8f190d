"""A hook manager that records every call of a run: hook, time, and modified arguments."""

from __future__ import annotations

import pickle
import random
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pluggy
import torch

from apil_core.plugins.hook_manager import RunHookManager
from apil_core.plugins.unchanged import changed, copies


@dataclass
class Call:
    """One call of an implemented hook.

    Attributes:
        hook: its name.
        plugins: called ones, in order of registration.
        within: plugins of the hooks from within which it was made.
        seconds: of processor time, in the plugins and in pluggy; with calls within it, without the recording.
    """

    hook: str
    plugins: tuple[str, ...]
    within: tuple[str, ...] = ()
    seconds: float = 0.0


@dataclass
class Mistake:
    """A violation of the hook contract.

    Attributes:
        check: key of ``METHOD_CHECKS``.
        hook: during which it was done.
        text: description.
    """

    check: str
    hook: str
    text: str


@dataclass
class _Open:
    call: Call
    before: Mapping[str, torch.Tensor]
    plain: str
    random: tuple[bytes, bytes, int]
    begin: float = 0.0
    recording: float = 0.0


class HookSpy:
    """Records the hook calls of a run.

    Attributes:
        calls: all calls of implemented hooks, in the order they began.
        mistakes: in the order they were seen; a call's own come after those of calls within it.
    """

    def __init__(self) -> None:
        self.calls: list[Call] = []
        self.mistakes: list[Mistake] = []
        self._open: list[_Open] = []

    def before(self, hook: str, impls: Sequence[pluggy.HookImpl], arguments: Mapping[str, Any]) -> None:
        """Called by pluggy before a call."""
        if not impls:
            return
        entered = time.process_time()
        within = tuple(name for opened in self._open for name in opened.call.plugins)
        call = Call(hook, tuple(impl.plugin_name for impl in impls), within)
        self.calls.append(call)
        self._open.append(_Open(call, copies(arguments), _plain(arguments), _random_states()))
        self._open[-1].begin = time.process_time()
        self._charge(self._open[-1].begin - entered, self._open[:-1])

    def after(
        self, outcome: Any, hook: str, impls: Sequence[pluggy.HookImpl], arguments: Mapping[str, Any]
    ) -> None:
        """Called by pluggy after a call, successful or not."""
        if not impls:
            return
        ended = time.process_time()
        opened = self._open.pop()
        opened.call.seconds = ended - opened.begin - opened.recording
        paths = changed(opened.before, arguments)
        if not paths and opened.plain != _plain(arguments):
            paths = [name for name in arguments if name != "run"]
        if paths:
            self._note("unchanged", opened.call, f"changed {', '.join(paths[:3])}")
        for name, then, now in zip(_GLOBAL, opened.random, _random_states(), strict=True):
            if then != now:
                self._note("randomness", opened.call, f"drew from, or seeded, {name}")
        self._charge(time.process_time() - ended, self._open)

    def _note(self, check: str, call: Call, text: str) -> None:
        # a nested call's mistake is its callers' too; it is reported once, where it happened
        if not any(mistake.check == check and mistake.text == text for mistake in self.mistakes):
            who = ", ".join(call.plugins)
            self.mistakes.append(Mistake(check, call.hook, f"{call.hook} (filled by {who}) {text}"))

    @staticmethod
    def _charge(seconds: float, opened: Sequence[_Open]) -> None:
        for one in opened:
            one.recording += seconds


_GLOBAL = ("torch's global generator", "numpy's global generator", "Python's module random")


def _random_states() -> tuple[bytes, bytes, int]:
    numpy_state = pickle.dumps(np.random.get_state())
    return torch.get_rng_state().numpy().tobytes(), numpy_state, hash(random.getstate())


def _plain(arguments: Mapping[str, Any]) -> str:
    """Numbers and strings in dict arguments (``metrics``, ``result``), without tensors."""
    return repr({name: _numbers(value) for name, value in arguments.items() if isinstance(value, Mapping)})


def _numbers(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _numbers(item) for key, item in value.items()}
    return None if isinstance(value, torch.Tensor) else value


def spied_hooks(spy: HookSpy) -> type[RunHookManager]:
    """Make a class of hook managers whose calls ``spy`` records."""

    class SpiedHooks(RunHookManager):
        """The real hook manager, with recording."""

        def __init__(self, *arguments: Any, **keywords: Any):
            super().__init__(*arguments, **keywords)
            self.manager.add_hookcall_monitoring(spy.before, spy.after)

    return SpiedHooks
