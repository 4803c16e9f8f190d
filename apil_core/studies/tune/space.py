"""The search space of a study: which settings its trials vary, and between what."""

from __future__ import annotations

import json
from collections.abc import Mapping
from os import PathLike
from typing import TYPE_CHECKING, Any

from pydantic import FiniteFloat, ValidationError, model_validator

from apil_core.api.config import RunConfig, Section
from apil_core.common.documents import plain
from apil_core.common.errors import ConfigError
from apil_core.config.layers import Layer, flag_layer, named_text, parse_yaml, shipped_names
from apil_core.config.problems import Problem, problems_of, raise_problems
from apil_core.config.resolve import flatten, resolve_layers
from apil_core.plugins.discovery import PluginRegistry

if TYPE_CHECKING:
    from optuna import Trial

_MEASURED = (
    *("version", "method", "env", "victim", "victim_sha256", "victim_side", "game", "steps", "seed"),
    *("evaluation", "plugins", "trust", "threads", "device"),
)
"""Settings that all trials share: what is attacked, for how long, and how it is scored."""

TRIALS = 20
"""Of a study, unless another number is asked for."""

Number = int | FiniteFloat


class Range(Section):
    """Numbers from ``low`` to ``high``, both included; whole ones where the setting or both ends are."""

    low: Number
    high: Number
    log: bool = False
    """Uniform in the logarithm."""

    @model_validator(mode="after")
    def _possible(self) -> Range:
        if not self.low < self.high:
            raise ValueError(f"low ({self.low}) must be below high ({self.high})")
        if self.log and self.low <= 0:
            raise ValueError("log needs a low above 0")
        return self


class Space:
    """A checked search space over a configuration.

    Args:
        source: a file, a shipped space's name, or the content: by dotted key a list of choices, or a mapping
            with ``low``, ``high`` and ``log``.
        config: the settings that trials share, complete.
        plugins: registry in which they are looked up.
        fixed: keys of the source that are not varied.

    Raises:
        ConfigError: a key or value is wrong, a line each.
    """

    def __init__(
        self,
        source: PathLike[str] | str | Mapping[str, Any],
        config: RunConfig,
        plugins: PluginRegistry,
        fixed: frozenset[str] = frozenset(),
    ):
        self.config, self.plugins = config, plugins
        self._base = flatten(plain(config))
        if isinstance(source, Mapping):
            text, origin = json.dumps(source), "space"
        else:
            text, origin = named_text(source, __package__, "spaces", "space")
        data, lines = parse_yaml(text, origin)
        self._origins = {
            key: origin if isinstance(source, Mapping) else f"{origin}:{lines[key]}" for key in lines
        }
        self.parts: dict[str, Range | list[Any]] = {}
        problems: list[Problem] = []
        for key, value in data.items():
            if key in fixed:
                continue
            if not isinstance(value, (list, dict)) or not value:
                problems.append(Problem((key,), "expected a list of choices, or low and high"))
                continue
            try:
                self.parts[key] = value if isinstance(value, list) else Range.model_validate(value)
            except ValidationError as error:
                problems += [Problem((key, *found.key), found.reason) for found in problems_of(error, Range)]
            if key.partition(".")[0] in _MEASURED:
                problems.append(Problem((key,), "is the same in all trials: it decides what is measured"))
        raise_problems(problems, self._origins)
        if not self.parts:
            raise ConfigError(f"{origin}: no key is left to vary")
        self._check()

    @property
    def content(self) -> dict[str, Any]:
        """The space as JSON values."""
        return {key: _plain(part) for key, part in self.parts.items()}

    def default(self) -> dict[str, Any] | None:
        """The configuration's own values as a trial's parameters; ``None`` where the space lacks one."""
        found = {}
        for key, part in self.parts.items():
            value = self._base.get(key)
            if isinstance(part, list):
                if value not in part:
                    return None
                found[key] = _label(value)
            elif isinstance(value, (int, float)) and part.low <= value <= part.high:
                found[key] = value
            else:
                return None
        return found

    def suggest(self, trial: Trial) -> RunConfig:
        """The settings of a trial, from the study's sampler; those it has already stay.

        Raises:
            ConfigError: they are impossible together.
        """
        values: dict[str, Any] = {}
        for key, part in self.parts.items():
            if isinstance(part, list):
                labels = [_label(choice) for choice in part]
                values[key] = part[labels.index(trial.suggest_categorical(key, labels))]
            elif self._is_whole(key, part):
                values[key] = trial.suggest_int(key, int(part.low), int(part.high), log=part.log)
            else:
                values[key] = trial.suggest_float(key, part.low, part.high, log=part.log)
        return self.with_values(values, f"trial {trial.number}")

    def with_values(self, values: Mapping[str, Any], origin: str) -> RunConfig:
        """The configuration with other values of some dotted keys.

        Raises:
            ConfigError: they are wrong; begins with ``origin``.
        """
        layer = flag_layer(values)
        layer.origins = dict.fromkeys(layer.origins, origin)
        return resolve_layers([Layer(plain(self.config)), layer], self.plugins)

    def _is_whole(self, key: str, part: Range) -> bool:
        whole = isinstance(part.low, int) and isinstance(part.high, int)
        return whole and not isinstance(self._base.get(key), float)

    def _check(self) -> None:
        """Try each key's ends and middle, or its choices, so that no trial is the first to find a typo."""
        wrong: list[str] = []
        for key, part in self.parts.items():
            values = part
            if isinstance(part, Range):
                middle = part.low + (part.high - part.low) * 0.37
                values = [part.low, part.high, *(() if self._is_whole(key, part) else (middle,))]
            for value in values:
                try:
                    self.with_values({key: value}, self._origins[key,])
                except ConfigError as error:
                    wrong.append(str(error))
                    break
        if wrong:
            raise ConfigError("\n".join(wrong))


def space_names() -> list[str]:
    """Spaces that ship with the package, each named like its method."""
    return shipped_names(__package__, "spaces")


def _label(choice: Any) -> str | int | float | bool | None:
    """A choice as Optuna stores it: anything but plain values as JSON."""
    return choice if isinstance(choice, (str, int, float, bool, type(None))) else json.dumps(choice)


def _plain(part: Range | list[Any]) -> Any:
    return part if isinstance(part, list) else part.model_dump(exclude_defaults=True)
