"""Settings of a distillation from flags and ``--set`` texts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from pydantic import ValidationError

from apil_core.config.game import game_model, profile_problems
from apil_core.config.layers import flag_layer, merge, set_layer
from apil_core.config.problems import problems_of, raise_problems
from apil_core.plugins.discovery import PluginRegistry
from apil_core.plugins.registry import default_plugins
from apil_core.runs.distillation.config import DistillConfig


def settings(
    flags: Mapping[str, Any], sets: Sequence[str] = (), plugins: PluginRegistry | None = None
) -> DistillConfig:
    """Flags over defaults, ``KEY=VALUE`` texts over both.

    Args:
        flags: values by setting; ``game.physics`` for the profile.
        sets: ``KEY=VALUE`` texts.
        plugins: know the game; default: the installed ones.

    Raises:
        ConfigError: one line per mistake.
    """
    data, origins = merge({}, [flag_layer(flags), *map(set_layer, sets)])
    try:
        config = DistillConfig.model_validate(data)
    except ValidationError as error:
        raise_problems(problems_of(error, DistillConfig), origins)
        raise
    model = game_model(config.env, plugins or default_plugins())
    raise_problems(profile_problems(data, model, config.env), origins)
    return config
