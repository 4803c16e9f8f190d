"""``apil config show | validate | schema | diff``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from apil_core.cli.app import sub_app
from apil_core.cli.flags import ConfigFlags, Json, Plugins
from apil_core.cli.output import console, print_json, table
from apil_core.common.errors import ConfigError

if TYPE_CHECKING:
    from apil_core.api.config import RunConfig
    from apil_core.config.layers import Layer

app = sub_app("config", "Show, validate, describe and compare configurations.")


@app.command
def show(*, flags: ConfigFlags | None = None, as_json: Json = False) -> None:
    """Print the complete configuration that "apil run" would use with the same flags."""
    from apil_core.config.resolve import dump_yaml

    config, plugins = (flags or ConfigFlags()).resolve()
    if as_json:
        print_json(config)
    else:
        print(dump_yaml(config, plugins), end="")


@app.command
def validate(file: Path, /, *, plugin: Plugins | None = None, as_json: Json = False) -> int:
    """Check a config file, down to the options of its method and game; exit code 2 if it is wrong.

    Parameters
    ----------
    file
        YAML file, or a run directory.
    """
    from apil_core.config.layers import file_layer

    try:
        config = _resolve([file_layer(file)], plugin)
    except ConfigError as error:
        if not as_json:
            raise
        print_json({"file": str(file), "valid": False, "errors": str(error).splitlines()})
        return error.exit_code
    if as_json:
        print_json({"file": str(file), "valid": True, "errors": []})
    else:
        console().print(f"{file}: valid ({config.method} on {config.env}, {config.steps:,} steps)")
    return 0


@app.command
def schema(
    *,
    method: Annotated[str | None, Parameter(help="Options of this method only [default: of all].")] = None,
    plugin: Plugins | None = None,
) -> None:
    """Print the JSON Schema of config files, for editors and other tools."""
    from apil_core.config.schema import json_schema
    from apil_core.plugins.discovery import discover

    print_json(json_schema(discover(plugin or []), method))


@app.command
def diff(first: str, second: str, /, *, plugin: Plugins | None = None, as_json: Json = False) -> None:
    """Show the keys in which two configurations differ.

    A side that names no method or game is completed with the other side's.

    Parameters
    ----------
    first
        Preset, YAML file or run directory.
    second
        Preset, YAML file or run directory.
    """
    from apil_core.config.resolve import differences

    layers = [_layer(first), _layer(second)]
    a, b = (_resolve([_names_of(other), own], plugin) for own, other in (layers, reversed(layers)))
    found = differences(a, b)
    if as_json:
        print_json({key: {"first": x, "second": y} for key, (x, y) in found.items()})
        return
    if not found:
        console().print("no difference")
        return
    rows = table("key", first, second)
    for key, (x, y) in found.items():
        rows.add_row(key, _shown(x), _shown(y))
    console().print(rows)


def _layer(name: str) -> Layer:
    """A preset by name, else a file or run directory."""
    from apil_core.config.layers import file_layer, preset_layer, preset_names

    is_path = Path(name).exists() or "/" in name or name.endswith((".yaml", ".yml"))
    return file_layer(Path(name)) if is_path and name not in preset_names() else preset_layer(name)


def _names_of(layer: Layer) -> Layer:
    from apil_core.config.layers import flag_layer

    return flag_layer({key: layer.data.get(key) for key in ("method", "env")})


def _resolve(layers: list[Layer], plugin: list[Path] | None) -> RunConfig:
    from apil_core.config.resolve import plugin_files, resolve_layers
    from apil_core.plugins.discovery import discover

    return resolve_layers(layers, discover([*plugin_files(layers), *(plugin or [])]))


def _shown(value: Any) -> str:
    return "–" if value is None else str(value)
