"""Observers switched on for scoring a policy, e.g. defences that were absent in its training."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from pydantic import create_model

from apil_core.api.config import RunConfig, Section
from apil_core.api.specs import options_model, titled
from apil_core.common.documents import plain
from apil_core.common.errors import ConfigError, UnknownNameError
from apil_core.config.layers import Key, Layer, merge, set_layer
from apil_core.config.problems import validated
from apil_core.plugins.discovery import PluginRegistry

Observers = Mapping[str, Mapping[str, Any]]
"""Names of observers, each with options that differ from its defaults."""


def with_observers(
    config: RunConfig, plugins: PluginRegistry, observers: Observers, sets: Sequence[str] = ()
) -> RunConfig:
    """A copy of ``config`` with further observers at the end, and all of their options explicit.

    ``config`` itself where there are none.

    Args:
        config: a run's.
        plugins: registry with the observers.
        observers: those to switch on.
        sets: ``options.NAME.KEY=VALUE`` texts about them; they take precedence.

    Raises:
        UnknownNameError: there is no such observer.
        ConfigError: it is on already, or its options are wrong: one line per mistake.
    """
    known = plugins.observer_names()
    if not isinstance(observers, Mapping):
        raise ConfigError("observers: must be a mapping of names to options, e.g. {'masked_observation': {}}")
    for name, values in observers.items():
        if not isinstance(values, Mapping):
            raise ConfigError(f"observers.{name}: should be a section of keys and values, got {values!r}")
        if name not in known:
            raise UnknownNameError("observer", name, known)
        if name in config.observers:
            raise ConfigError(f"observer {name!r}: the adversary's run has it switched on already")
    if not observers:
        return config
    specs = [plugins.observers[name] for name in observers if name in plugins.observers]
    fields: Any = {s.name: (options_model(s.config, titled(s)), ...) for s in specs if s.config}
    section = create_model("ObserverOptions", __base__=Section, **fields)
    model = create_model("Settings", __base__=Section, options=(section, ...))
    given = {name: dict(values) for name, values in observers.items() if values or name in fields}
    origins: dict[Key, str] = {("options", name): "observers" for name in given}
    data, written = merge({}, [Layer({"options": given}, origins), *map(set_layer, sets)])
    options = plain(validated(model, data, written))["options"]
    return config.model_copy(
        update={
            "observers": (*config.observers, *observers),
            "options": {**config.options, **options},
        },
        deep=True,
    )


def about(observers: Observers, sets: Sequence[str]) -> tuple[list[str], list[str]]:
    """The ``KEY=VALUE`` texts about options of these observers, and the others."""
    theirs = [text for text in sets if _owner(text) in observers]
    return theirs, [text for text in sets if text not in theirs]


def _owner(assignment: str) -> str:
    """The NAME of an ``options.NAME…=VALUE``, or nothing."""
    section, _, rest = assignment.partition("=")[0].strip().partition(".")
    return rest.partition(".")[0] if section == "options" else ""
