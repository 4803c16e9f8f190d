"""Flags made from pydantic models: their help is the fields' own text and defaults."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import NoneType
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, TypeVar, get_origin

from cyclopts import Group, Parameter
from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from apil_core.api.config import RunConfig
from apil_core.common.annotations import alternatives
from apil_core.config.layers import located, preset_names
from apil_core.config.problems import model_at
from apil_core.evaluation.options import EvaluationOptions, PairingOptions

if TYPE_CHECKING:
    from apil_core.config.layers import Layer
    from apil_core.plugins.discovery import PluginRegistry

_SETTINGS = Group("What to train", sort_key=0)
_SOURCES = Group("Where settings come from (defaults < presets < file < flags < --set)", sort_key=1)

_REST = Group("Output", sort_key=3)

Json = Annotated[
    bool,
    Parameter(
        name="--json",
        show_default=False,
        group=_REST,
        help="Print the result as JSON on stdout, and nothing else there.",
    ),
]
Show = Annotated[
    bool,
    Parameter(
        show_default=False,
        group=_REST,
        help="In the end also draw the learning curve (curve.png) and record a won game (won-game.mp4).",
    ),
]
Quiet = Annotated[bool, Parameter(show_default=False, group=_REST, help="No progress display.")]
Plugins = Annotated[
    list[Path],
    Parameter(name="--plugin", show_default=False, help="One-file plugin to load; repeatable."),
]


_SPELLING: dict[str, dict[str, Any]] = {
    "method": {"alias": "-m"},
    "env": {"alias": "-e"},
    "observers": {"name": "--observer", "metavar": "NAME"},
    "sets": {"name": "--set", "metavar": "KEY=VALUE"},
    "checkpoint_path": {"name": "--checkpoint"},
    "plugin_files": {"name": "--plugin"},
    "contact_sheet": {"name": "--out"},
    "variants": {"name": "--variant", "metavar": "KEY=VALUE,…"},
}
"""Flag names that differ from their field's."""

Made = TypeVar("Made", bound="Flags")
Model = TypeVar("Model", bound=BaseModel)


class Flags:
    """Flags of a model's fields; see :func:`flags_of`."""

    keys: ClassVar[dict[str, str]]

    def given(self) -> dict[str, Any]:
        """The flags that were set, by key of the model."""
        values = {key: getattr(self, name) for name, key in self.keys.items()}
        return {key: value for key, value in values.items() if value is not None and value is not False}


class PairingFlags(Flags):
    """Flags of :class:`apil_core.evaluation.options.PairingOptions`, or of a subclass."""

    def options(self, model: type[Model]) -> Model:
        """The options these flags stand for.

        Raises:
            ConfigError: a value that makes no sense.
        """
        given = self.given()
        for key in ("plugin_files", "sets"):
            given[key] = tuple(map(str, given.get(key, ())))
        given["observers"] = {name: {} for name in given.get("observers", ())}
        return model(**given)


def flags_of(
    model: type[BaseModel],
    groups: Mapping[Group | None, Sequence[str]],
    texts: Mapping[str, str] | None = None,
) -> Callable[[type[Made]], type[Made]]:
    """Add a flag for each of these fields of a model, before those the class declares itself.

    Args:
        model: whose fields' text and default are the flag's help; ``None`` in the class stands for a flag
            that was not given.
        groups: keys by the group of the help they are shown in; those of sections have dots, and
            ``game.physics`` is the profile of a model's game.
        texts: help of keys for which the field's text does not apply, or ``[default: …]`` in its place.
    """

    def decorate(cls: type[Made]) -> type[Made]:
        annotations: dict[str, Any] = {}
        cls.keys = {}
        for group, keys in groups.items():
            for key in keys:
                name = key.rpartition(".")[2]
                cls.keys[name] = key
                annotations[name], default = _flag(_field(model, key), name, group, (texts or {}).get(key))
                setattr(cls, name, default)
        cls.__annotations__ = {**annotations, **inspect.get_annotations(cls)}
        return Parameter(name="*")(dataclass(cls))

    return decorate


def _field(model: type[BaseModel], key: str) -> FieldInfo:
    if key == "game.physics":
        return PairingOptions.model_fields["physics"]
    *sections, name = key.split(".")
    section = model_at(model, tuple(sections))
    assert section is not None
    return section.model_fields[name]


def _flag(info: FieldInfo, name: str, group: Group | None, text: str | None) -> tuple[Any, Any]:
    """Return the type and default of the flag of one field."""
    kind = _kind(info.annotation, name)
    own = " ".join(str(info.description).split())
    if text is None or text.startswith("[default: "):
        text = own if text is None else f"{own.partition(' [default: ')[0].rstrip('.')} {text}."
    if "[default: " not in text and kind is not bool and not info.is_required():
        text += f" [default: {info.default}]" if info.default not in (None, (), "", PydanticUndefined) else ""
    options: dict[str, Any] = {"help": text, **_SPELLING.get(name, {}), **({"group": group} if group else {})}
    wanted: Any = kind if kind is bool else kind | None
    return Annotated[wanted, Parameter(show_default=False, **options)], False if kind is bool else None


def _kind(annotation: Any, name: str) -> Any:
    """Return the type of one value of a flag: a field's type without ``None`` and bounds."""
    kind = next(kind for kind in alternatives(annotation) if kind is not NoneType)
    if get_origin(kind) in (tuple, dict):
        return list[Path] if name == "plugin_files" else list[str]
    return kind


def setting_flag(text: str, group: Group) -> Parameter:
    """The flag ``--set``, with its help and its place there."""
    return Parameter(name="--set", show_default=False, metavar="KEY=VALUE", group=group, help=text)


def _source(text: str, **options: Any) -> Any:
    return Parameter(help=text, group=_SOURCES, show_default=False, **options)


@flags_of(
    RunConfig,
    {
        _SETTINGS: (
            *("method", "env", "victim", "steps", "num_envs", "threads", "seed", "game.physics", "device"),
            "init_from",
        )
    },
    {"game.physics": "[default: faithful]"},
)
class ConfigFlags(Flags):
    """Flags for everything in a run's configuration."""

    preset: Annotated[
        list[str],
        _source(f"Ready-made settings: {', '.join(preset_names())}; repeatable.", metavar="NAME"),
    ] = field(default_factory=list)
    config: Annotated[Path | None, _source("YAML file, or a run directory to copy the settings of.")] = None
    set: Annotated[
        list[str],
        _source("One setting, e.g. options.apil.prediction=oracle; repeatable.", metavar="KEY=VALUE"),
    ] = field(default_factory=list)
    plugin: Annotated[list[Path], _source("One-file plugin to load; repeatable.")] = field(
        default_factory=list
    )

    def layers(self) -> list[Layer]:
        """The configuration layers these flags stand for."""
        from apil_core.config.resolve import gather, plugin_files

        flags = self.given()
        if "init_from" in flags:
            flags["init_from"] = located(flags["init_from"], Path())
        if self.plugin:  # in addition to those in files
            below = plugin_files(gather(self.config, self.preset, self.set))
            flags["plugins"] = [*below, *(str(path.absolute()) for path in self.plugin)]
        return gather(self.config, self.preset, self.set, flags)

    def resolve(self) -> tuple[RunConfig, PluginRegistry]:
        """The checked configuration, and the plugins it was checked against.

        Raises:
            ApilError: one line per mistake.
        """
        from apil_core.config.resolve import plugin_files, resolve_layers
        from apil_core.plugins.discovery import discover

        layers = self.layers()
        plugins = discover(plugin_files(layers))
        return resolve_layers(layers, plugins), plugins


_PLAYED = (
    *("env", "victim", "physics", "adversary_actions", "victim_actions", "sets", "observers"),
    *("checkpoint_path", "plugin_files"),
)
_SCORED = (
    *("episodes", "blind", "blind_imitator", "blind_victim"),
    *("seed", "num_envs", "threads", "device"),
)


@flags_of(EvaluationOptions, {None: (*_PLAYED, *_SCORED)})
class EvaluationFlags(PairingFlags):
    """Flags for the players, the game and the counts of an evaluation."""


@flags_of(PairingOptions, {None: (*_PLAYED, "seed")})
class PlayFlags(PairingFlags):
    """Flags for the players and the game."""


ADVERSARY = Parameter(
    name="ADVERSARY", help="Run directory, policy (zoo:GAME/SIDE/v1, onnx:FILE, …), random or zero."
)
