"""``apil new method | game | victim``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from apil_core.cli.app import sub_app
from apil_core.cli.flags import Json
from apil_core.cli.output import console, emit

if TYPE_CHECKING:
    from apil_core.plugins.scaffold.names import Kind
    from apil_core.plugins.scaffold.package import Written

_Name = Annotated[str, Parameter(name="NAME", help="Small letters, digits and hyphens, e.g. my-idea.")]
_Out = Annotated[Path | None, Parameter(help="Directory to write, empty or not there yet [default: NAME].")]

app = sub_app("new", "Write a plugin package that installs, passes its own tests and runs at once.")


@app.command
def method(name: _Name, /, *, out: _Out = None, as_json: Json = False) -> None:
    """Write an attack method: a bonus in the reward, an option, state that is saved, on toy-pursuit."""
    _write("method", name, out, as_json)


@app.command
def game(name: _Name, /, *, out: _Out = None, as_json: Json = False) -> None:
    """Write a two-player game, batched in numpy, with a scripted victim in it."""
    _write("game", name, out, as_json)


@app.command
def victim(
    name: _Name,
    /,
    *,
    env: Annotated[str, Parameter(alias="-e", help="Game it plays.")] = "toy-pursuit",
    side: Annotated[str | None, Parameter(help="Its side [default: the one that is attacked].")] = None,
    out: _Out = None,
    as_json: Json = False,
) -> None:
    """Write a victim: a torch network with its weights in a safetensors file, in a seat of a game."""
    _write("victim", name, out, as_json, env, side)


def _write(
    kind: Kind, name: str, out: Path | None, as_json: bool, env: str = "", side: str | None = None
) -> None:
    from apil_core.plugins.registry import default_plugins
    from apil_core.plugins.scaffold.names import new_names
    from apil_core.plugins.scaffold.package import write_package
    from apil_core.plugins.scaffold.seat import find_seat

    plugins = default_plugins()
    names = new_names(kind, name, plugins)
    seat = find_seat(env, side, plugins) if kind == "victim" else None
    written = write_package(names, out, seat)
    emit(_document(written), as_json, lambda: _print(written))


def _document(written: Written) -> dict[str, object]:
    names = written.names
    return {
        "kind": names.kind,
        "name": names.registered,
        "package": names.package,
        "distribution": names.distribution,
        "directory": str(written.directory),
        "files": list(written.files),
        "next": list(written.commands),
    }


def _print(written: Written) -> None:
    out, names = console(), written.names
    called = f"{names.kind} {names.registered}" if names.kind != "victim" else f"victims {names.registered}:…"
    out.print(f"{written.shown}: {called}, package {names.package}, {len(written.files)} files")
    out.print("next:")
    for command in written.commands:
        out.print(f"  {command}", soft_wrap=True)
