"""The section ``game`` of a configuration: its model, and the effect of naming a physics profile.

A profile hides the single values (``solver``, ``timestep``, …) set on lower layers: naming a profile asks
for its physics, overriding any file or stored run. Values on the same layer as the profile or above it
stay; flags and ``--set`` count as one layer.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any

from pydantic import BaseModel, create_model

from apil_core.api.config import RunConfig, Section
from apil_core.api.profiles import ProfiledOptions
from apil_core.api.specs import options_model
from apil_core.common.documents import plain
from apil_core.common.errors import ApilError
from apil_core.config.layers import Key, Layer, flag_layer, merge, set_layer
from apil_core.config.problems import Problem, raise_problems, validated
from apil_core.config.schema import NoOptions
from apil_core.plugins.discovery import PluginRegistry
from apil_core.plugins.registry import default_plugins

PHYSICS = "physics"
"""The option that names a profile."""


def game_model(env: str, plugins: PluginRegistry) -> type[BaseModel]:
    """The model of a game's options.

    Raises:
        ApilError: there is no such game, or its model cannot be loaded.
    """
    reference = plugins.game(env).config
    return options_model(reference) if reference else NoOptions


def profile_keys(model: type[BaseModel]) -> tuple[str, ...]:
    """The options set by a profile; none for a game without profiles."""
    return model.profile_keys() if issubclass(model, ProfiledOptions) else ()


def settled(layers: Sequence[Layer], model: type[BaseModel]) -> list[Layer]:
    """The layers without the single values that a profile named above them hides."""
    keys = profile_keys(model)
    levels = [len(layers) if layer.command_line else place for place, layer in enumerate(layers)]
    named = [level for layer, level in zip(layers, levels, strict=True) if PHYSICS in layer.section("game")]
    highest = max(named, default=-1) if keys else -1
    return [
        layer.without("game", keys) if level < highest else layer
        for layer, level in zip(layers, levels, strict=True)
    ]


def overlaid(
    model: type[BaseModel], options: Mapping[str, Any], changed: Mapping[str, Any]
) -> dict[str, Any]:
    """``options`` with ``changed`` over them; a profile in ``changed`` hides single values of the former."""
    layers = settled([Layer({"game": dict(options)}), Layer({"game": dict(changed)})], model)
    game: dict[str, Any] = merge({}, layers)[0]["game"]
    return game


def profile_problems(data: Mapping[str, Any], model: type[BaseModel], env: str) -> list[Problem]:
    """A profile for a game that has none."""
    game = data.get("game")
    if PHYSICS in model.model_fields or not isinstance(game, Mapping) or PHYSICS not in game:
        return []
    return [Problem(("game", PHYSICS), f"game {env} has no physics profiles")]


def with_game_options(
    config: RunConfig,
    plugins: PluginRegistry,
    options: Mapping[str, Any] | None = None,
    sets: Sequence[str] = (),
    physics: str | None = None,
) -> RunConfig:
    """A copy of ``config`` with single options of its game changed, and all of them explicit.

    Only the section ``game`` is read: the rest of a stored config stays unchanged.

    Args:
        config: names the game.
        plugins: registry with the game's model.
        options: values by option.
        sets: ``game.KEY=VALUE`` texts; they take precedence.
        physics: profile to play in, overriding single values in ``config``; as ``--physics``.

    Raises:
        ConfigError: one line per mistake.
    """
    own = game_model(config.env, plugins)
    model = _settings_model(own)
    origins: dict[Key, str] = {("game", key): "game_options" for key in options or {}}
    given = Layer({"game": dict(options or {})}, origins, command_line=True)
    asked = [flag_layer({f"game.{PHYSICS}": physics}), given, *map(set_layer, sets)]
    data, written = merge({"game": {}}, settled([Layer({"game": config.game}), *asked], own))
    raise_problems(profile_problems(data, own, config.env), written)
    return config.model_copy(update=plain(validated(model, data, written)), deep=True)


@lru_cache(maxsize=32)  # takes 4 ms to make, and a report asks for it once a score
def _settings_model(own: type[BaseModel]) -> type[BaseModel]:
    return create_model("Settings", __base__=Section, game=(own, ...))


def spelt_out(env: str, options: Mapping[str, Any], plugins: PluginRegistry) -> dict[str, Any]:
    """A game's options with defaults and the profile's values filled in.

    Equivalent sets of options give equal results, e.g. one stored before profiles existed.

    Raises:
        ApilError: no such game, or options its model refuses.
    """
    config = with_game_options(RunConfig(env=env), plugins, options)
    model = game_model(env, plugins).model_validate(config.game)
    return {**config.game, **(model.settings if isinstance(model, ProfiledOptions) else {})}


def stored_game(config: RunConfig) -> dict[str, Any]:
    """:func:`spelt_out` for a stored run; unchanged where only a one-file plugin registers its game."""
    try:
        return spelt_out(config.env, config.game, default_plugins())
    except ApilError:
        return config.game


def stored_physics(config: RunConfig) -> str | None:
    """The physics profile of a stored run, or ``"custom"``; ``None`` for a game without profiles."""
    name = stored_game(config).get(PHYSICS)
    return name if isinstance(name, str) else None
