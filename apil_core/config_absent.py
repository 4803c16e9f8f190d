"""Stored settings that lack keys added since: each means what its absence meant when they were stored."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel

from apil_core.config import Absent, RunConfig
from apil_core.config_layers import texts_in
from apil_core.config_models import full_model
from apil_core.errors import ApilError
from apil_core.plugins import PluginRegistry


def with_absent(data: Mapping[str, Any], plugins: PluginRegistry) -> dict[str, Any]:
    """Settings that a run stored, complete: of the core, of its methods and observers, and of its game.

    Args:
        data: as JSON or YAML has them; may lack keys, not have wrong ones.
        plugins: know the models of options. Options of what is not among them stay as they are.
    """
    model: type[BaseModel] = RunConfig
    try:
        parts = plugins.run_plugins(str(data.get("method", "")), texts_in(data.get("observers")))
        model = full_model(plugins, parts, str(data.get("env", "")))
    except ApilError:  # something of it is not installed: whoever builds it says so
        return filled(data, RunConfig)
    opened: dict[str, Any] = {spec.name: {} for spec in parts if spec.config}
    return filled({**data, "options": {**opened, **(data.get("options") or {})}}, model)


def completed(config: RunConfig, plugins: PluginRegistry) -> RunConfig:
    """A stored config with what plugins that the run names itself (one-file ones) have added since."""
    return RunConfig.model_validate(with_absent(config.model_dump(mode="json"), plugins))


def filled(data: Mapping[str, Any], model: type[BaseModel]) -> dict[str, Any]:
    """``data`` with every key of ``model`` it lacks, at the value marked ``absent``, or else its default."""
    complete = dict(data)
    for name, field in model.model_fields.items():
        section = field.annotation if isinstance(field.annotation, type) else None
        inside = complete.get(name, {})
        if section and issubclass(section, BaseModel) and isinstance(inside, Mapping):
            complete[name] = filled(inside, section)
        elif name not in complete and not field.is_required():
            marked = [mark.value for mark in field.metadata if isinstance(mark, Absent)]
            complete[name] = marked[0] if marked else field.get_default(call_default_factory=True)
    return complete
