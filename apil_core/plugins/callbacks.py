"""Callbacks of a run: observers given as objects."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from apil_core.common.errors import PluginError
from apil_core.plugins.defined import ORIGIN, add
from apil_core.plugins.discovery import PluginRecord, PluginRegistry

if TYPE_CHECKING:  # imports torch
    from apil_core.api.method import Callback

_WATCHING = {"run_started", "run_finished", "iteration_finished", "evaluation_finished"}


def with_callbacks(
    plugins: Callable[[], PluginRegistry], callbacks: Sequence[Callback]
) -> tuple[PluginRegistry, tuple[str, ...]]:
    """The registry of one run with these callbacks, and the names of those that take part in it.

    Those must be named in the run's ``observers``, and are known to this process from now on.

    Args:
        plugins: finds the others.
        callbacks: each of another class.

    Raises:
        PluginError: a callback's hooks are wrong, or its class's name is taken.
    """
    watching: dict[str, Callback] = {}
    acting: dict[str, Callback] = {}
    for callback in callbacks:
        name = type(callback).__name__
        if name in watching or name in acting:
            raise PluginError(f"callbacks: two are named {name}; rename a class")
        alone = PluginRegistry()
        alone.add(PluginRecord(name, "", ORIGIN), callback)
        if error := alone.records[0].error:
            raise PluginError(f"callbacks: {name}: {error}")
        (watching if set(alone.records[0].hooks) <= _WATCHING else acting)[name] = callback
    add(acting)
    return replace(plugins(), watchers=watching), tuple(acting)
