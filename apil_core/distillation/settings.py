"""Settings of a distillation from flags and ``--set`` texts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from pydantic import ValidationError

from apil_core.config_errors import problems_of, raise_problems
from apil_core.config_layers import flag_layer, merge, set_layer
from apil_core.distillation.options import DistillConfig


def settings(flags: Mapping[str, Any], sets: Sequence[str] = ()) -> DistillConfig:
    """Flags over defaults, ``KEY=VALUE`` texts over both.

    Raises:
        ConfigError: one line per mistake.
    """
    data, origins = merge({}, [flag_layer(flags), *map(set_layer, sets)])
    try:
        return DistillConfig.model_validate(data)
    except ValidationError as error:
        raise_problems(problems_of(error, DistillConfig), origins)
        raise
