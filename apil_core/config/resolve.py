"""From files, presets, ``--set`` and flags to one checked ``RunConfig``, and back to YAML.

Layers: defaults < presets < file < flags < ``--set``. They are merged first and validated once, by
the core's model with the options of the method's chain and of the game typed in; every mistake
becomes one line that starts with where it was written.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from apil_core.api.config import SCHEMA_VERSION, RunConfig
from apil_core.api.specs import GameSpec, MethodSpec, RunPluginSpec, titled
from apil_core.common.documents import plain
from apil_core.common.errors import ConfigError, suggest
from apil_core.config.absent import read_stored, with_absent
from apil_core.config.game import game_model, profile_problems, settled
from apil_core.config.kind import KIND, IsRetrainingError
from apil_core.config.layers import (
    Key,
    Layer,
    file_layer,
    file_layers,
    flag_layer,
    located,
    merge,
    preset_layer,
    preset_names,
    set_layer,
    texts_in,
)
from apil_core.config.problems import Problem, problems_of, raise_problems, unknown_name
from apil_core.config.schema import full_model
from apil_core.config.yaml import dump_yaml as dump_yaml
from apil_core.plugins.default_victim import default_victim
from apil_core.plugins.defined import as_text, define
from apil_core.plugins.discovery import PluginRegistry

_IDENTITY = ("version", "method", "env", "victim", "steps", "num_envs", "seed", "reward", "ppo", "options")
"""Keys of every stored config; a default in their place would silently be another run."""


def gather(
    file: Path | None = None,
    presets: Sequence[str] = (),
    sets: Sequence[str] = (),
    flags: Mapping[str, Any] | None = None,
) -> list[Layer]:
    """The layers of one configuration, lowest first.

    Args:
        file: a YAML file, or a run directory. Presets that it names lie below ``presets``.
        presets: names, the later ones on top.
        sets: ``a.b=c`` texts.
        flags: values by config key; ``None`` means not given.

    Raises:
        ConfigError: a layer cannot be read.
        UnknownNameError: there is no such preset.
    """
    *named, own = file_layers(Path(file)) if file is not None else [Layer({})]
    return [*named, *map(preset_layer, presets), own, flag_layer(flags or {}), *map(set_layer, sets)]


def plugin_files(layers: Sequence[Layer]) -> tuple[str, ...]:
    """One-file plugins the layers name: they must be loaded before names can be checked."""
    value = merge({}, layers)[0].get("plugins") or ()
    return tuple(map(str, value)) if isinstance(value, (list, tuple)) else ()


def resolve(
    file: Path | None = None,
    presets: Sequence[str] = (),
    sets: Sequence[str] = (),
    flags: Mapping[str, Any] | None = None,
    *,
    plugins: PluginRegistry,
) -> RunConfig:
    """The complete configuration: every option of the method's chain and of the game filled in.

    Raises:
        ConfigError: one line per mistake.
    """
    return resolve_layers(gather(file, presets, sets, flags), plugins)


def resolve_layers(layers: Sequence[Layer], plugins: PluginRegistry) -> RunConfig:
    """:func:`resolve` for layers already gathered.

    Raises:
        ConfigError: one line per mistake.
    """
    base = RunConfig().model_dump()
    layers = [
        replace(layer, data=with_absent(layer.data, plugins)) if layer.stored else layer for layer in layers
    ]
    data, origins = merge(base, layers)
    check_version(data, origins)
    problems = _unknown_names(data, plugins)
    unknown = {problem.key[0] for problem in problems}
    if "method" in unknown or not isinstance(data["method"], str):
        model: type[RunConfig] = RunConfig
    else:
        parts = plugins.run_plugins(data["method"], texts_in(data["observers"]))
        used = [spec.name for spec in parts]
        layers = [layer.without_options(used) if layer.preset else layer for layer in layers]
        env = data["env"] if isinstance(data["env"], str) and "env" not in unknown else None
        layers = layers if env is None else settled(layers, game_model(env, plugins))
        data, origins = merge(base, layers)
        problems += [] if env is None else profile_problems(data, game_model(env, plugins), env)
        _open_sections(data, [spec.name for spec in parts if spec.config])
        model = full_model(plugins, parts, env)
        problems += _foreign_options(data, parts, plugins)
    try:
        validated = model.model_validate(_without_keys(data, problems))
    except ValidationError as error:
        problems += problems_of(error, model)
    raise_problems(problems, origins)
    return _complete(validated, plugins.game(validated.env), plugins)


def complete(config: RunConfig, plugins: PluginRegistry) -> RunConfig:
    """A configuration made in Python, checked and filled in like one from files.

    Raises:
        ConfigError: one line per mistake.
    """
    data = plain(config)
    # stored configs resolve relative paths against their own directory
    data["plugins"] = [str(Path(path).resolve()) for path in config.plugins]
    data["init_from"] = located(config.init_from, Path())
    return resolve_layers([Layer(data, {(key,): "RunConfig" for key in data})], plugins)


def _load_config(source: Path | str | None, presets: Sequence[str], settings: Mapping[str, Any]) -> RunConfig:
    """See :meth:`apil_core.RunConfig.load`."""
    from apil_core.plugins.registry import plugins_with

    values = {"game.physics" if key == "physics" else key: as_text(value) for key, value in settings.items()}
    if isinstance(values.get("method", ""), (type, MethodSpec)):
        values["method"] = define(values["method"])[0]
    if isinstance(source, str) and source in preset_names():
        presets, source = [*presets, source], None
    layer = flag_layer(values)
    layer.origins = dict.fromkeys(layer.origins, "RunConfig.load")
    layers = [*gather(None if source is None else Path(source), presets), layer]
    return resolve_layers(layers, plugins_with(plugin_files(layers)))


def load_resolved(path: Path) -> RunConfig:
    """Load a run's stored config unchanged; plugins' options are not checked again.

    Keys added since, the core's and installed plugins', get the value their absence meant then.

    Raises:
        ConfigError: it cannot be read, is wrong or of a newer version.
        IsRetrainingError: it is a retraining's.
    """
    from apil_core.plugins.registry import default_plugins

    data = file_layer(Path(path), quick=True).data
    if data.get("kind") == KIND:
        folder = Path(path).parent
        raise IsRetrainingError(f"{folder} is a retraining, no run; its victim is retrained:{folder}")
    try:
        check_version(data, {})
        config = read_stored(data, default_plugins(), RunConfig)
    except (ConfigError, ValidationError) as error:  # once more, for its lines
        origins = file_layer(Path(path)).origins
        check_version(data, origins)
        raise_problems(problems_of(error, RunConfig) if isinstance(error, ValidationError) else [], origins)
        raise
    missing = [key for key in _IDENTITY if key not in data]
    if missing:
        raise ConfigError(f"{path}: incomplete, lacks {', '.join(missing)}: damaged, or not stored by a run")
    return config


def check_version(data: Mapping[str, Any], origins: Mapping[Key, str]) -> None:
    """Refuse a config written for a newer schema: its other errors would mislead.

    Raises:
        ConfigError: ``version`` is above this code's.
    """
    version = data.get("version")
    if isinstance(version, int) and version > SCHEMA_VERSION:
        reason = f"is {version}, newer than this apil understands ({SCHEMA_VERSION}): upgrade apil"
        raise_problems([Problem(("version",), reason)], origins)


def flatten(data: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Dotted keys → values of nested mappings."""
    flat: dict[str, Any] = {}
    for key, value in data.items():
        if isinstance(value, Mapping) and value:
            flat.update(flatten(value, f"{prefix}{key}."))
        else:
            flat[f"{prefix}{key}"] = value
    return flat


def differences(a: RunConfig, b: RunConfig) -> dict[str, tuple[Any, Any]]:
    """Dotted keys whose values differ; ``None`` where one side has no such key."""
    first, second = (flatten(config.model_dump(mode="json")) for config in (a, b))
    keys = [*first, *(key for key in second if key not in first)]
    return {k: (first.get(k), second.get(k)) for k in keys if first.get(k) != second.get(k)}


def _unknown_names(data: Mapping[str, Any], plugins: PluginRegistry) -> list[Problem]:
    named: dict[str, tuple[str, list[str]]] = {
        "method": ("method", list(plugins.methods)),
        "env": ("game", plugins.game_names()),
        "recorders": ("recorder", list(plugins.recorders)),
        "observers": ("observer", plugins.observer_names()),
    }
    problems = []
    for key, (kind, known) in named.items():
        value = data[key]
        if isinstance(value, str):
            fine = plugins.has_game(value) if key == "env" else key != "method" or value in known
            problems += [] if fine else [unknown_name((key,), kind, value, known)]
        elif isinstance(value, (list, tuple)):
            for i, name in enumerate(value):
                if not isinstance(name, str):
                    continue  # reported by the model
                if key == "observers" and name in plugins.modules and name not in known:
                    reason = f"plugin {name!r} fills no run hook: there is nothing to switch on"
                    problems.append(Problem((key, i), reason))
                elif name not in known:
                    problems.append(unknown_name((key, i), kind, name, known))
                elif name in value[:i]:
                    problems.append(Problem((key, i), f"{name!r} is named twice"))
    device = data["device"]
    if isinstance(device, str) and not re.fullmatch(r"cpu|cuda(:\d+)?", device):
        problems.append(unknown_name(("device",), "device", device, ["cpu", "cuda", "cuda:N"]))
    return problems


def _open_sections(data: dict[str, Any], configurable: Sequence[str]) -> None:
    """Add an options section for every plugin with options, so that its defaults are filled in."""
    options = data["options"]
    if isinstance(options, Mapping):
        given = {name: {} if section is None else section for name, section in options.items()}
        data["options"] = {**{name: {} for name in configurable}, **given}


def _foreign_options(
    data: Mapping[str, Any], parts: Sequence[RunPluginSpec], plugins: PluginRegistry
) -> list[Problem]:
    """Option sections that nothing in this run reads."""
    if not isinstance(data["options"], Mapping):
        return []
    used = {spec.name: spec for spec in parts}
    readers = ", ".join(spec.name for spec in parts if spec.config) or "none"
    problems = []
    for name in data["options"]:
        if name in used:
            if used[name].config:
                continue
            reason = f"{titled(used[name])} has no options"
        elif name in plugins.methods:
            method = data["method"]
            reason = f"method {method!r} does not use {name!r} (option sections it reads: {readers})"
        elif name in plugins.observers:
            reason = f"observer {name!r} is not switched on: name it in observers"
        else:
            known = [*plugins.methods, *plugins.observers]
            reason = f"unknown method or observer {name!r}{suggest(str(name), known)}"
        problems.append(Problem(("options", name), reason))
    return problems


def _without_keys(data: Mapping[str, Any], problems: Sequence[Problem]) -> dict[str, Any]:
    """``data`` without the options already found wrong, so that none is reported twice."""
    kept = dict(data)
    for section in ("options", "game"):
        wrong = {problem.key[1] for problem in problems if problem.key[0] == section}
        if wrong:
            kept[section] = {name: value for name, value in data[section].items() if name not in wrong}
    return kept


def _complete(config: RunConfig, game: GameSpec, plugins: PluginRegistry) -> RunConfig:
    """Plain ``RunConfig`` with the game's defaults explicit."""
    data = plain(config)
    own = game.rewards
    rewards = {
        "dense_weight": own.dense_weight,
        "sparse_weight": own.sparse_weight,
        "anneal_fraction": own.anneal_fraction,
    }
    for key, value in rewards.items():
        data["reward"][key] = value if data["reward"][key] is None else data["reward"][key]
    if data["victim_side"] is None:
        data["victim_side"] = game.victim_side
    if data["victim"] == "auto" and data["victim_side"] == game.victim_side and game.default_victim:
        data["victim"] = default_victim(game, plugins)
    try:
        return RunConfig.model_validate(data)
    except ValidationError as error:  # a game's spec with impossible weights
        raise ConfigError(f"game {game.name!r} has wrong defaults: {error}") from error
