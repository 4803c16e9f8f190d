"""Reference pages made from the code: the command line by cyclopts, settings from the pydantic models."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

from pydantic import BaseModel

from apil_core import RunConfig
from apil_core.api.specs import options_model
from apil_core.cli.app import make_app
from apil_core.config.layers import preset_layer, preset_names
from apil_core.config.resolve import flatten
from apil_core.plugins.discovery import PluginRegistry

_BOUNDS = {"minimum": "≥ {}", "exclusiveMinimum": "> {}", "maximum": "≤ {}", "exclusiveMaximum": "< {}"}
_KINDS = {
    "integer": "integer",
    "number": "number",
    "string": "text",
    "boolean": "`true`, `false`",
    "array": "list",
    "object": "mapping",
    "null": "`null`",
}

_CLI = """\
# Command line

Made from the program itself: what `apil VERB --help` prints. Mistakes are one line each on stderr and exit
with 2 ([all exit codes](configuration.md#exit-codes)); `--json` prints a result as one JSON document.

"""

_CONFIG = """\
# Every setting

Made from the models that read a configuration, those of all installed plugins included. Layers, presets and
error messages are explained in [configuration](configuration.md). `apil config show` prints the settings of
one run, with these texts as comments; `apil config schema` prints them as JSON Schema for editors.

On the command line a key is `--set KEY=VALUE`; in a file its dots are nesting.

"""


def cli_page() -> str:
    """Every verb with its flags."""
    text = make_app().generate_docs("markdown")
    verbs = text.index("\n## ", text.index("## Table of Contents") + 1)
    overview = text[text.index("\n**", text.index("## Table of Contents")) : verbs]
    lines = (overview + text[verbs:]).splitlines()
    return _CLI + "\n".join(_as_code(line) for line in lines) + "\n"


def _as_code(line: str) -> str:
    """Headings like ``## apil run`` with the command as code; everything else as it is."""
    marks, _, rest = line.partition(" ")
    return f"{marks} `{rest}`" if marks in ("##", "###", "####") else line


def config_page(plugins: PluginRegistry) -> str:
    """Every key of a configuration: the core's, then the options of methods and of games."""
    parts = [_CONFIG, "## A run\n\n", _table(_core_rows())]
    for spec in sorted(plugins.methods.values(), key=lambda spec: spec.name):
        if spec.config:
            model = options_model(spec.config)
            parts += [f"\n## Options of `{spec.name}`\n\n", f"{spec.summary}.\n\n" if spec.summary else ""]
            parts.append(_table(list(rows(model.model_json_schema(), f"options.{spec.name}."))))
    for names, model in _games(plugins):
        named = ", ".join(f"`{name}`" for name in names)
        parts += [f"\n## Options of {named}\n\n", _table(list(rows(model.model_json_schema(), "game.")))]
    return "".join(parts)


def method_addendum(name: str, plugins: PluginRegistry) -> str:
    """What a method's page gets on the site: its keys in the reference, and what presets make of them."""
    spec = plugins.methods.get(name)
    if spec is None:
        return ""
    text = "\n## On the command line\n\n"
    text += f"```sh\napil run --method {name} --env toy-pursuit --steps 100k\n```\n\n"
    if spec.requires:
        needed = ", ".join(f"`{each}`" for each in spec.requires)
        text += f"It requires {needed}, whose hooks are active as well.\n\n"
    if spec.config is None:
        return text + "It has no options of its own.\n"
    text += f"Types and bounds of its options: [every setting](../settings.md#options-of-{name}).\n"
    found = [(preset, key, value) for preset in preset_names() for key, value in _set_by(preset, name)]
    if not found:
        return f"{text}\nNo preset changes them.\n"
    lines = (f"| `{preset}` | `{key}` | `{json.dumps(value)}` |\n" for preset, key, value in found)
    return f"{text}\n| preset | sets | to |\n|---|---|---|\n{''.join(lines)}"


def _set_by(preset: str, method: str) -> Iterator[tuple[str, Any]]:
    section = preset_layer(preset).data.get("options", {}).get(method, {})
    yield from flatten(section, f"options.{method}.").items()


def _games(plugins: PluginRegistry) -> list[tuple[list[str], type[BaseModel]]]:
    """Games by the model of their options, in the order of registration."""
    shared: dict[str, list[str]] = {}
    for spec in plugins.games.values():
        if spec.config:
            shared.setdefault(spec.config, []).append(f"{spec.name}:…" if spec.family else spec.name)
    return [(names, options_model(reference)) for reference, names in shared.items()]


def _core_rows() -> list[tuple[str, str, str, str]]:
    skipped = ("game", "options")  # typed by the plugins, below
    return [row for row in rows(RunConfig.model_json_schema(), "") if row[0] not in skipped]


def rows(schema: dict[str, Any], prefix: str) -> Iterator[tuple[str, str, str, str]]:
    """(key, values, default, meaning) of every setting in a JSON Schema's object, nested ones with dots."""
    definitions = schema.get("$defs", {})
    for name, field in schema.get("properties", {}).items():
        nested = definitions.get(field.get("$ref", "").rpartition("/")[2])
        if nested and "properties" in nested:
            yield from rows({**nested, "$defs": definitions}, f"{prefix}{name}.")
        else:
            meaning = " ".join(field.get("description", "").split())
            yield (
                f"{prefix}{name}",
                values(field),
                json.dumps(field.get("default"), ensure_ascii=False),
                meaning,
            )


def values(field: dict[str, Any]) -> str:
    """What a setting may be, in words: ``number > 0``, ``one of …``."""
    if "anyOf" in field:
        return ", ".join(dict.fromkeys(values(each) for each in field["anyOf"]))
    if "const" in field:
        return f"`{field['const']}`"
    if "enum" in field:
        return ", ".join(f"`{each}`" for each in field["enum"])
    kind = _KINDS[field.get("type", "object")]
    if field.get("type") == "array" and "items" in field:
        kind = (
            f"list of {values(field['items'])}s"
            if field["items"].get("type") in ("integer", "number", "string")
            else kind
        )
    bounds = [text.format(field[key]) for key, text in _BOUNDS.items() if key in field]
    return " ".join([kind, ", ".join(bounds)]).strip()


def _table(found: list[tuple[str, str, str, str]]) -> str:
    lines = (
        f"| `{key}` | {kind} | `{default}` | {_cell(meaning)} |\n" for key, kind, default, meaning in found
    )
    return f"| key | values | default | meaning |\n|---|---|---|---|\n{''.join(lines)}"


def _cell(text: str) -> str:
    """A sentence as a table's cell: bars and asterisks are not markup there."""
    return text.replace("|", "\\|").replace("*", "\\*")
