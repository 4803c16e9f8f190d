"""Sources of config values: files, presets, ``--set`` and flags, each with the origins of its values.

A layer is plain nested data plus, for every key in it, the start of its error messages
(``paper.yaml:3``, ``--set ppo.epochs=0``, ``preset paper``).
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from importlib import resources
from io import StringIO
from os import PathLike
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from apil_core.common.errors import ConfigError, RunDirError, UnknownNameError, suggest
from apil_core.common.files import read_json, write_atomically
from apil_core.common.trust import named_in

Key = tuple[str | int, ...]

CONFIG, ENVIRONMENT = "config.yaml", "environment.json"
"""Files of every run directory: its settings, and the environment they were used in."""

_CHARACTERS, _NODES, _DEPTH = 200_000, 20_000, 50
"""Limits of a YAML text: more than any settings need, less than is slow to read."""

_SHOWN = 200
"""Characters of a ``--set`` that messages show."""
_PATH_KEYS = ("init_from", "plugins")
POLICY_NAME = re.compile(r"[a-z][a-z0-9_-]+:")
"""Start of a policy name: its scheme."""


@dataclass
class Layer:
    """One source of values.

    Attributes:
        data: nested mappings, lists and scalars.
        origins: key path → where it was written.
        preset: True for presets: their options for unused methods are dropped, other layers' are errors.
        command_line: True for flags and ``--set``.
        stored: True for a run's config: a missing key was added later and gets the meaning of its absence.
    """

    data: dict[str, Any]
    origins: dict[Key, str] = field(default_factory=dict)
    preset: bool = False
    command_line: bool = False
    stored: bool = False

    def section(self, name: str) -> Mapping[str, Any]:
        """The values below a top-level key; empty where there are none."""
        value = self.data.get(name)
        return value if isinstance(value, Mapping) else {}

    def without(self, name: str, keys: Sequence[str]) -> Layer:
        """The same layer without some keys of a section."""
        kept = {key: value for key, value in self.section(name).items() if key not in keys}
        data = {**self.data, name: kept} if self.section(name) else self.data
        hidden = {(name, key) for key in keys}
        origins = {key: origin for key, origin in self.origins.items() if key[:2] not in hidden}
        return replace(self, data=data, origins=origins)

    def without_options(self, used: Sequence[str]) -> Layer:
        """The same layer with the option sections of methods in ``used`` only."""
        options = self.data.get("options")
        if not isinstance(options, Mapping):
            return self
        kept = {name: section for name, section in options.items() if name in used}
        return replace(self, data={**self.data, "options": kept})


def shipped_names(package: str, folder: str) -> list[str]:
    """Names of the YAML files that ship in a folder of a package."""
    entries = (resources.files(package) / folder).iterdir()
    return sorted(entry.name[:-5] for entry in entries if entry.name.endswith(".yaml"))


def named_text(name: PathLike[str] | str, package: str, folder: str, kind: str) -> tuple[str, str]:
    """Text of a file, or of the one of that name that ships in a package's folder.

    Args:
        name: path, or name without ``.yaml``.
        package, folder: where shipped ones are.
        kind: what they are, for messages.

    Returns:
        the text, and its name for messages.

    Raises:
        ConfigError: there is none, or it cannot be read.
    """
    path, shipped = Path(name), shipped_names(package, folder)
    if str(name) in shipped and not path.is_file():
        return (resources.files(package) / folder / f"{name}.yaml").read_text("utf-8"), f"{kind} {name}"
    try:
        return path.read_text("utf-8"), str(path)
    except FileNotFoundError:
        hint = suggest(str(name), shipped)
        raise ConfigError(f"{name}: no such file, and no {kind} that ships with apil{hint}") from None
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{name}: cannot be read: {error}") from error


def preset_names() -> list[str]:
    """Presets that ship with the package."""
    return shipped_names("apil_core.config", "presets")


def preset_layer(name: str) -> Layer:
    """The values of a preset.

    Raises:
        UnknownNameError: there is no preset of that name.
    """
    if name not in preset_names():
        raise UnknownNameError("preset", name, preset_names())
    text = (resources.files("apil_core.config") / "presets" / f"{name}.yaml").read_text("utf-8")
    data, lines = parse_yaml(text, f"preset {name}")
    return Layer(data, dict.fromkeys(lines, f"preset {name}"), preset=True)


def file_layer(path: Path, *, quick: bool = False) -> Layer:
    """The values of a YAML file, or of the ``config.yaml`` in a run directory.

    Relative paths in it (``plugins``, ``init_from``) are relative to the file. With ``quick`` values come,
    without origins, from the copy that :func:`write_copy` left, if there is one of that very text.

    Raises:
        ConfigError: it cannot be read or is not a YAML mapping.
    """
    path = path / CONFIG if path.is_dir() else path
    try:
        text = path.read_text("utf-8")
    except FileNotFoundError:
        raise ConfigError(f"{path}: no such file") from None
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: cannot be read: {error}") from error
    copied = _copied(path, text) if quick else None
    data, lines = parse_yaml(text, str(path)) if copied is None else (copied, {})
    data = from_folder(path.parent, data)
    named_in(path, data)
    origins = {key: f"{path}:{line}" for key, line in lines.items()}
    return Layer(data, origins, stored=(path.parent / ENVIRONMENT).is_file() and path.name == CONFIG)


def file_layers(path: Path) -> list[Layer]:
    """The presets that a file names under ``presets``, lowest first, and its own values.

    Raises:
        ConfigError: it cannot be read, is not a YAML mapping, or names what is no preset.
    """
    layer = file_layer(path)
    names = layer.data.pop("presets", None) or []
    names = [names] if isinstance(names, str) else names
    try:
        if len(texts_in(names)) != len(names):
            raise ConfigError("should be a list of names, such as [paper]")
        return [*map(preset_layer, names), layer]
    except (ConfigError, UnknownNameError, TypeError) as error:
        raise ConfigError(f"{layer.origins[('presets',)]}: presets: {error}") from error


def write_copy(path: Path, text: str) -> None:
    """Cache the values of ``path``'s YAML ``text`` beside it as JSON, which listings read much faster."""
    data, _ = parse_yaml(text, str(path))
    copy = json.dumps({"sha256": hashlib.sha256(text.encode()).hexdigest(), "data": data}, default=str)
    if json.loads(copy)["data"] == data:
        write_atomically(path.with_suffix(".json"), lambda file: file.write(copy.encode()))


def _copied(path: Path, text: str) -> dict[str, Any] | None:
    with suppress(RunDirError):
        copy = read_json(path.with_suffix(".json")) or {}
        if copy.get("sha256") == hashlib.sha256(text.encode()).hexdigest() and isinstance(copy["data"], dict):
            return copy["data"]
    return None


def from_folder(folder: Path, data: Mapping[str, Any]) -> dict[str, Any]:
    """Settings whose relative paths (``plugins``, ``init_from``) start in that folder, made absolute."""
    return {key: _relative_to(folder, value) if key in _PATH_KEYS else value for key, value in data.items()}


def set_layer(assignment: str) -> Layer:
    """The one value of a ``--set a.b=c``; the value is read as YAML.

    Raises:
        ConfigError: it has no ``=``, an empty key or a value that is no YAML.
    """
    shown = " ".join(assignment.split())
    origin = f"--set {shown if len(shown) < _SHOWN else shown[:_SHOWN] + '…'}"
    dotted, equals, text = assignment.partition("=")
    parts = tuple(dotted.strip().split("."))
    if not equals or not all(parts):
        raise ConfigError(f"{origin}: expected key=value, e.g. ppo.epochs=8")
    value, _ = _read(text, f"{origin}: the value is not YAML", lines=False)
    return Layer(_nest(parts, value), dict.fromkeys(_keys(value, parts), origin), command_line=True)


def flag_layer(flags: Mapping[str, Any]) -> Layer:
    """Values of flags by config key (``num_envs``, ``game.physics``); ``None`` means not given."""
    data: dict[str, Any] = {}
    origins: dict[Key, str] = {}
    for key, value in flags.items():
        if value is not None:
            parts = tuple(key.split("."))
            name = "plugin" if key == "plugins" else parts[-1].replace("_", "-")
            data = _overlay(data, _nest(parts, value))
            origins[parts] = f"--{name} {_shown(value)}"
    return Layer(data, origins, command_line=True)


def texts_in(value: Any) -> list[str]:
    """The strings in an unchecked value that should be a list of strings."""
    return [item for item in value if isinstance(item, str)] if isinstance(value, (list, tuple)) else []


def merge(base: Mapping[str, Any], layers: Sequence[Layer]) -> tuple[dict[str, Any], dict[Key, str]]:
    """``base`` merged with the layers, later ones on top, and the origins of their values."""
    data: dict[str, Any] = dict(base)
    origins: dict[Key, str] = {}
    for layer in layers:
        data = _overlay(data, layer.data)
        origins = {key: o for key, o in origins.items() if not _covered(key, layer)} | layer.origins
    return data, origins


def parse_yaml(text: str, origin: str) -> tuple[dict[str, Any], dict[Key, int]]:
    """Data of a YAML mapping and the line (from 1) of each of its keys.

    Raises:
        ConfigError: it is not YAML or not a mapping; the message starts with ``origin:line``.
    """
    data, root = _read(text, origin)
    if data is None:
        return {}, {}
    if not isinstance(data, dict):
        raise ConfigError(f"{origin}:1: expected keys and values, got {type(data).__name__}")
    lines: dict[Key, int] = {}
    _collect_lines(root, (), lines)
    return data, lines


def _read(text: str, origin: str, *, lines: bool = True) -> tuple[Any, Node | None]:
    """Data of a YAML text and its nodes.

    Raises:
        ConfigError: it is not YAML, or larger than any settings are; begins with ``origin`` and the line.
    """
    yaml = YAML(typ="safe", pure=True)
    try:
        if len(text) > _CHARACTERS:
            raise ValueError(f"{len(text):,} characters, settings have {_CHARACTERS:,} at most")
        root = yaml.compose(StringIO(text))
        _check_size(root)
        return None if root is None else yaml.constructor.construct_document(root), root
    except RecursionError as error:
        raise ConfigError(f"{origin}: nested too deeply") from error
    except (YAMLError, ValueError, TypeError, AttributeError) as error:  # ValueError: e.g. an impossible date
        mark = getattr(error, "problem_mark", None) or getattr(error, "context_mark", None)
        line = f":{mark.line + 1}" if mark and lines else ""
        raise ConfigError(f"{origin}{line}: {_reason(error)}") from error


def _check_size(root: Node | None) -> None:
    """Count nodes, aliased ones each time: a few aliases can expand to more than fits in memory."""
    stack, count = [(root, 0)], 0
    while stack:
        node, depth = stack.pop()
        count += 1
        if count > _NODES or depth > _DEPTH:
            raise ValueError(f"more than {_NODES:,} values or {_DEPTH} levels (aliases count each time)")
        if isinstance(node, MappingNode):
            for key, value in node.value:
                if not isinstance(key, ScalarNode):
                    raise ValueError(f"line {key.start_mark.line + 1}: a key must be one word")
                stack.append((value, depth + 1))
        elif isinstance(node, SequenceNode):
            stack += [(item, depth + 1) for item in node.value]


def _collect_lines(node: Node | None, prefix: Key, lines: dict[Key, int]) -> None:
    if isinstance(node, MappingNode):
        for key, value in node.value:
            lines[(*prefix, key.value)] = key.start_mark.line + 1
            _collect_lines(value, (*prefix, key.value), lines)
    elif isinstance(node, SequenceNode):
        for index, item in enumerate(node.value):
            lines[(*prefix, index)] = item.start_mark.line + 1


def _overlay(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    merged = dict(base)
    for key, value in over.items():
        below = merged.get(key)
        if isinstance(below, Mapping) and isinstance(value, Mapping):
            merged[key] = _overlay(below, value)
        elif not (isinstance(below, Mapping) and value is None):  # an empty section changes nothing
            merged[key] = value
    return merged


def _covered(key: Key, layer: Layer) -> bool:
    """True if ``layer`` determines ``key``: sets it, sets something below it, or replaces it."""
    for other in layer.origins:
        if other[: len(key)] == key:
            return True
        if key[: len(other)] == other and not isinstance(_value_at(layer.data, other), Mapping):
            return True
    return False


def _value_at(data: Any, key: Key) -> Any:
    for part in key:
        if isinstance(data, list) and isinstance(part, int):
            data = data[part]
        else:
            data = data.get(part) if isinstance(data, Mapping) else None
    return data


def _keys(data: Any, prefix: Key) -> list[Key]:
    below = data.items() if isinstance(data, Mapping) else ()
    return [prefix, *(key for name, value in below for key in _keys(value, (*prefix, name)))]


def located(name: str | None, folder: Path) -> str | None:
    """A path, relative to ``folder``, made absolute; a policy's name (scheme, colon, …) as it is."""
    return (
        name if name is None or POLICY_NAME.match(name) else str((folder / Path(name).expanduser()).resolve())
    )


def _relative_to(folder: Path, value: Any) -> Any:
    if isinstance(value, str):
        return located(value, folder)
    if isinstance(value, list):
        return [_relative_to(folder, item) for item in value]
    return value


def _nest(parts: Sequence[str], value: Any) -> dict[str, Any]:
    for part in reversed(parts[1:]):
        value = {part: value}
    return {parts[0]: value}


def _shown(value: Any) -> str:
    return " ".join(map(str, value)) if isinstance(value, (list, tuple)) else str(value)


_WORDS = (
    ("another document", "a second document begins here: settings are one"),
    (
        "mapping values are not",
        "a key inside the value above it: check the indent, and quote text with a colon",
    ),
    ("expected <block end>", "the indent fits no line above"),
    ("'\\t' that cannot", "a tab: indent with spaces"),
    ("for the tag", "a tag (!…) is no setting: a list is written [1, 2]"),
)
"""Parts of YAML's messages, and what they mean to one who writes settings."""


def _reason(error: Exception) -> str:
    text = getattr(error, "problem", None) or str(error)
    said = " ".join(text.split("\n")[0].split())
    return next((words for part, words in _WORDS if part in text), said)
