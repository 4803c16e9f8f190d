"""The complete typed model of one run's config: the core's, each method's and the game's in one."""

from __future__ import annotations

import re
from collections.abc import Iterable
from functools import lru_cache
from typing import Any

from pydantic import BaseModel, Field, create_model

from apil_core.api.config import RunConfig, Section
from apil_core.api.specs import RunPluginSpec, options_model, titled
from apil_core.config.layers import preset_names
from apil_core.plugins.discovery import PluginRegistry


class NoOptions(Section):
    """For a game without options."""


def full_model(
    plugins: PluginRegistry, parts: Iterable[RunPluginSpec], env: str | None = None
) -> type[RunConfig]:
    """``RunConfig`` with ``options`` typed by the models of methods and observers, ``game`` by the game's.

    Args:
        plugins: where the game is looked up.
        parts: methods and observers whose options are allowed.
        env: the game; ``None`` leaves its options untyped.
    """
    sections = tuple((spec.name, options_model(spec.config, titled(spec))) for spec in parts if spec.config)
    reference = plugins.game(env).config if env is not None else None
    game = options_model(reference) if reference else NoOptions if env is not None else None
    return _full_model(sections, game)


@lru_cache(maxsize=32)  # takes 5 ms to make, and a matrix or a search space asks for hundreds
def _full_model(
    sections: tuple[tuple[str, type[BaseModel]], ...], game: type[BaseModel] | None
) -> type[RunConfig]:
    options: Any = {name: (model, ...) for name, model in sections}
    fields: Any = {"options": _field("options", create_model("MethodOptions", __base__=Section, **options))}
    if game is not None:
        fields["game"] = _field("game", game)
    return create_model("RunConfig", __base__=RunConfig, **fields)


def json_schema(plugins: PluginRegistry, method: str | None = None) -> dict[str, Any]:
    """JSON Schema of config files: of one method's, or with the options of all; of observers in any case."""
    methods = plugins.method_chain(method) if method else plugins.methods.values()
    model = full_model(plugins, [*methods, *plugins.observers.values()])
    schema = model.model_json_schema()
    schema.pop("required", None)  # a file may omit keys with a default
    for section in schema.get("$defs", {}).values():
        if section.get("title") == "MethodOptions":
            section.pop("required", None)
    schema["properties"]["presets"] = {"type": ["string", "array"], "items": {"enum": preset_names()}}
    schema["properties"]["method"]["enum"] = [method] if method else sorted(plugins.methods)
    schema["properties"]["env"].update(_game_schema(plugins))
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}


def _game_schema(plugins: PluginRegistry) -> dict[str, Any]:
    """The names of games as JSON Schema: a list, and a pattern for each family if there are any."""
    specs = plugins.games.values()
    known = {"enum": sorted(spec.name for spec in specs if not spec.family)}
    families = sorted(re.escape(spec.name) for spec in specs if spec.family)
    patterns = [{"type": "string", "pattern": f"^{name}:."} for name in families]
    return {"anyOf": [known, *patterns]} if patterns else known


def _field(name: str, model: type[BaseModel]) -> tuple[type[BaseModel], Any]:
    return model, Field(description=RunConfig.model_fields[name].description)
