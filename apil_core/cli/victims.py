"""``apil victims list | check | import | download``."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from apil_core.cli.app import sub_app
from apil_core.cli.flags import Json, Plugins
from apil_core.cli.output import console, emit, styled, table

if TYPE_CHECKING:
    from apil_core.api.specs import PolicyListing
    from apil_core.policies.inspection import Inspection
    from apil_core.policies.zoo_import import ImportRow

CANNOT_PLAY = 2
"""Exit code of ``check`` where the policy cannot take the seat."""

app = sub_app("victims", "List, check, import and download victims.")


@app.command(name="list")
def list_(*, plugin: Plugins | None = None, as_json: Json = False) -> None:
    """List the victims there are, whether their weights are on this machine, and where they come from."""
    rows = _listings(plugin or [])
    emit(rows, as_json, lambda: _print_list(rows))


@app.command
def check(
    name: Annotated[str, Parameter(name="NAME", help="Policy, e.g. onnx:FILE, or a run directory.")],
    /,
    *,
    env: Annotated[str, Parameter(alias="-e", help="Game it is to play.")],
    side: Annotated[str | None, Parameter(help="Its side [default: the one that is attacked].")] = None,
    plugin: Plugins | None = None,
    as_json: Json = False,
) -> int:
    """Load a policy and try whether it can take a seat: sizes, bounds, memory, speed, and what is wrong."""
    from apil_core.plugins.discovery import discover
    from apil_core.policies.inspection import inspect_policy

    found = inspect_policy(name, env, side, discover(plugin or []), trust=True)
    emit(found, as_json, lambda: _print_inspection(found))
    return CANNOT_PLAY if found.errors else 0


@app.command(name="import")
def import_(
    directory: Annotated[Path, Parameter(name="DIR", help="Upstream's agent-zoo folder.")],
    /,
    *,
    as_json: Json = False,
) -> None:
    """Convert the zoo's published pickles, checked by SHA-256, to safetensors on this machine."""
    from apil_core.policies.zoo import import_zoo

    with _reported(as_json) as rows:
        rows += import_zoo(directory)


@app.command
def download(
    *,
    game: Annotated[
        list[str] | None, Parameter(help="Only this game's agents; repeatable [default: all].")
    ] = None,
    base_url: Annotated[
        str | None, Parameter(help="Mirror to fetch from [default: upstream at the pinned commit].")
    ] = None,
    as_json: Json = False,
) -> None:
    """Fetch the zoo's published weights, check their SHA-256 and convert them."""
    from apil_core.policies.zoo import download_zoo

    with _reported(as_json) as rows:
        rows += download_zoo(game, base_url)


def _print_list(rows: list[PolicyListing]) -> None:
    lines = [
        (row.name, styled("yes", "green") if row.available else "no", row.sha256[:12], row.provenance)
        for row in rows
    ]
    console().print(table("victim", "here", "sha256", "provenance", rows=lines))
    if not all(row.available for row in rows):
        console().print("missing ones: apil victims import DIR, or: apil victims download")


def _listings(plugin: list[Path]) -> list[PolicyListing]:
    from apil_core.plugins.default_victim import listings
    from apil_core.plugins.discovery import discover

    return [row for spec in discover(plugin).policies.values() for row in listings(spec)]


def _print_inspection(found: Inspection) -> None:
    out = console()
    bounds = "not stated" if found.action_bounds is None else "{:g} to {:g}".format(*found.action_bounds)
    facts = {
        "policy": found.name,
        "sha256": found.sha256[:12],
        "seat": f"{found.side} of {found.game}",
        "observations": str(found.observation_size),
        "actions": f"{found.action_size}, bounds {bounds}",
    }
    if found.steps_per_second is not None:
        facts["memory"] = "recurrent" if found.recurrent else "none"
        facts["draws"] = "stochastic" if found.stochastic else "deterministic"
        facts["speed"] = f"{found.steps_per_second:,.0f} steps/s with 128 games"
    facts |= {key: value for key, value in found.provenance.items() if key not in facts}
    for key, value in facts.items():
        out.print(f"{key:<13} {value}")
    for kind, lines in (("error", found.errors), ("note", found.notes)):
        for line in lines:
            out.print(f"{kind + ':':<13} {line}")
    if not found.errors:
        out.print("it can take this seat")


@contextmanager
def _reported(as_json: bool) -> Iterator[list[ImportRow]]:
    """Print the rows that the block collects; after an error those that were imported, if any."""
    from apil_core.policies.zoo import ZooImportError

    def listing() -> None:
        for row in rows:
            console().print(f"{row.name}  sha256 {row.sha256[:12]}  from {row.source}")
        console().print(f"{len(rows)} victims imported" if rows else "nothing to do: all are here already")

    rows: list[ImportRow] = []
    try:
        yield rows
    except ZooImportError as error:
        if rows := [row for row in error.rows if not row.error]:
            emit(rows, as_json, listing)
        raise
    emit(rows, as_json, listing)
