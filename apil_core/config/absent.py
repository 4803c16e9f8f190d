"""Stored settings that lack keys added since: each gets the meaning of its absence at storing time."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from typing import Any, TypeVar

from pydantic import BaseModel
from pydantic_core import to_jsonable_python

from apil_core.api.config import Absent, RunConfig
from apil_core.api.specs import Reference, RunPluginSpec, options_model
from apil_core.common.annotations import section_of
from apil_core.common.errors import ApilError, ConfigError, suggest
from apil_core.config.layers import texts_in
from apil_core.plugins.discovery import PluginRegistry

Model = TypeVar("Model", bound=BaseModel)


def with_absent(
    data: Mapping[str, Any], plugins: PluginRegistry, model: type[BaseModel] = RunConfig
) -> dict[str, Any]:
    """Stored settings, completed: the core's, methods' and observers', and the game's; unchecked.

    Args:
        data: as JSON or YAML has them.
        plugins: registry with the models of options. Options of unregistered plugins stay as they are.
        model: of the settings: a run's, or others that name a game.

    Returns:
        the settings as JSON values.
    """
    complete = filled(data, model)
    options = complete.get("options")
    if "options" in model.model_fields and isinstance(options, Mapping):
        complete["options"] = opened = dict(options)
        for spec in _parts(complete, plugins):
            _fill(opened, spec.name, spec.config)
    with suppress(ApilError):  # a game that is not installed is reported when it is played
        _fill(complete, "game", plugins.game(str(complete.get("env", ""))).config)
    jsonable: dict[str, Any] = to_jsonable_python(complete, fallback=repr)
    return jsonable


def read_stored(data: Mapping[str, Any], plugins: PluginRegistry, model: type[Model]) -> Model:
    """Checked settings from :func:`with_absent`; errors concern only values in ``data`` itself.

    Raises:
        ValidationError: pydantic's, if a value is wrong.
    """
    model.model_validate(data)
    return model.model_validate(with_absent(data, plugins, model))


def completed(config: RunConfig, plugins: PluginRegistry) -> RunConfig:
    """A stored config with what plugins that the run names itself (one-file ones) have added since.

    Raises:
        ConfigError: its method, or one of its observers, is not known here.
    """
    for kind, names, known in (
        ("method", (config.method,), list(plugins.methods)),
        ("observer", config.observers, plugins.observer_names()),
    ):
        for name in names:
            if name not in known:
                raise ConfigError(
                    f"the run's {kind} {name!r} is not known here{suggest(name, known)}: install its plugin, "
                    "or in Python pass its class (apil_core.define) or callback again"
                )
    return read_stored(config.model_dump(mode="json"), plugins, RunConfig)


def filled(data: Mapping[str, Any], model: type[BaseModel]) -> dict[str, Any]:
    """``data`` with every key of ``model`` it lacks, at the value marked ``absent``, or else its default."""
    complete = dict(data)
    for name, field in model.model_fields.items():
        marked = [mark.value for mark in field.metadata if isinstance(mark, Absent)]
        section = section_of(field.annotation)
        if name not in complete and (marked or not field.is_required()):
            value = marked[0] if marked else field.get_default(call_default_factory=True)
            # what a section's default does not state itself may be marked inside
            complete[name] = value.model_dump(exclude_unset=True) if isinstance(value, BaseModel) else value
        if section is not None and isinstance(complete.get(name), Mapping):
            complete[name] = filled(complete[name], section)
    return complete


def _parts(data: Mapping[str, Any], plugins: PluginRegistry) -> tuple[RunPluginSpec, ...]:
    with suppress(ApilError):  # a method that is not installed is reported when it is built
        return plugins.run_plugins(str(data.get("method", "")), texts_in(data.get("observers")))
    return ()


def _fill(sections: dict[str, Any], name: str, reference: Reference | None) -> None:
    """Fill the section of that name, absent or empty ones too, by the model that a spec refers to."""
    section = {} if sections.get(name) is None else sections[name]
    if reference is not None and isinstance(section, Mapping):
        sections[name] = filled(section, options_model(reference))
