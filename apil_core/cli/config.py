"""``apil config show | validate | schema | diff``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from apil_core.cli.app import sub_app
from apil_core.cli.flags import ConfigFlags, Json, Plugins
from apil_core.cli.output import console, emit, print_json, table
from apil_core.common.errors import ApilError, ConfigError

if TYPE_CHECKING:
    from apil_core.api.config import RunConfig
    from apil_core.config.layers import Layer

app = sub_app("config", "Show, validate, describe and compare configurations.")


@app.command
def show(*, flags: ConfigFlags | None = None, as_json: Json = False) -> None:
    """Print the complete configuration that "apil run" would use with the same flags."""
    from apil_core.config.resolve import dump_yaml

    config, plugins = (flags or ConfigFlags()).resolve()
    emit(config, as_json, lambda: print(dump_yaml(config, plugins), end=""))


@app.command
def validate(file: Path, /, *, plugin: Plugins | None = None, as_json: Json = False) -> int:
    """Check every key of a config file, and that what it names is there; exit code 2 if something is wrong.

    Loads no code but that of installed plugins and trusted files; "apil run --dry-run" tries it all.

    Parameters
    ----------
    file
        YAML file, or a run directory.
    """
    errors, config = _checked(file, plugin or [])
    if config is None or errors:
        if not as_json:
            raise ConfigError("\n".join(errors))
        print_json({"file": str(file), "valid": False, "errors": errors})
        return ConfigError.exit_code
    text = f"{file}: valid ({config.method} on {config.env}, {config.steps:,} steps)"
    emit({"file": file, "valid": True, "errors": []}, as_json, lambda: console().print(text))
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

    sides = [_layers(first), _layers(second)]
    a, b = (_resolve([_names_of(other), *own], plugin) for own, other in (sides, reversed(sides)))
    found = differences(a, b)
    rows = [(key, *("–" if value is None else str(value) for value in pair)) for key, pair in found.items()]
    shown = table("key", first, second, rows=rows) if found else "no difference"
    document = {key: {"first": x, "second": y} for key, (x, y) in found.items()}
    emit(document, as_json, lambda: console().print(shown))


def _checked(file: Path, more: list[Path]) -> tuple[list[str], RunConfig | None]:
    """Errors of a config file, one per line; plugins that cannot be loaded do not stop the other checks."""
    from apil_core.config.resolve import gather, plugin_files, resolve_layers
    from apil_core.plugins.default_victim import why_absent
    from apil_core.plugins.discovery import discover

    layers = gather(file)
    errors: list[str] = []
    try:
        plugins = discover([*plugin_files(layers), *more])
    except ApilError as error:
        errors, plugins = str(error).splitlines(), discover(more)
    try:
        config = resolve_layers(layers, plugins)
    except ConfigError as error:
        return [*errors, *str(error).splitlines()], None
    for key, name in (("victim", config.victim), ("init_from", config.init_from)):
        if reason := why_absent(name, plugins) if name else "":
            errors.append(f"{file}: {key}: {reason}")
    return errors, config


def _layers(name: str) -> list[Layer]:
    """Load a preset by name, else a file or run directory."""
    from apil_core.config.layers import file_layers, preset_layer, preset_names

    is_path = Path(name).exists() or "/" in name or name.endswith((".yaml", ".yml"))
    return file_layers(Path(name)) if is_path and name not in preset_names() else [preset_layer(name)]


def _names_of(layers: list[Layer]) -> Layer:
    from apil_core.config.layers import flag_layer, merge

    data = merge({}, layers)[0]
    return flag_layer({key: data.get(key) for key in ("method", "env")})


def _resolve(layers: list[Layer], plugin: list[Path] | None) -> RunConfig:
    from apil_core.config.resolve import plugin_files, resolve_layers
    from apil_core.plugins.discovery import discover

    return resolve_layers(layers, discover([*plugin_files(layers), *(plugin or [])]))
