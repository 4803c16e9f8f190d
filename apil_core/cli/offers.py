"""``apil plugins | games | methods``: what is installed, and what is wrong with what is broken."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING

from apil_core.cli.flags import Json, Plugins
from apil_core.cli.output import console, print_json, table

if TYPE_CHECKING:
    from apil_core.plugins import PluginRecord, PluginRegistry


def plugins(*, plugin: Plugins | None = None, as_json: Json = False) -> int:
    """List plugins: name, version, origin, hooks and offers; a broken one with its error.

    Exit code 1 if any plugin is broken.
    """
    records = _discover(plugin).records
    if as_json:
        print_json([asdict(record) for record in records])
    else:
        rows = table("plugin", "version", "offers", "hooks", "origin")
        for record in records:
            offers = f"[red]{_escaped(record.error)}[/]" if record.error else _offers(record)
            rows.add_row(record.name, record.version, offers, ", ".join(record.hooks), record.origin)
        console().print(rows)
    return int(any(record.error for record in records))


def games(*, plugin: Plugins | None = None, as_json: Json = False) -> None:
    """List games: sides, default victim on this machine, and what they are."""
    from apil_core.default_victim import default_victim

    plugins = _discover(plugin)
    specs = [spec for _, spec in sorted(plugins.games.items())]
    if as_json:
        print_json([{**asdict(spec), "victim_here": default_victim(spec, plugins)} for spec in specs])
        return
    rows = table("game", "attacked side", "adversary", "default victim", "what it is")
    for spec in specs:
        victim, adversary = spec.sides[spec.victim_side], spec.sides[1 - spec.victim_side]
        rows.add_row(spec.label, victim, adversary, default_victim(spec, plugins) or "–", spec.summary)
    console().print(rows)


def methods(*, plugin: Plugins | None = None, as_json: Json = False) -> None:
    """List attack methods: what they build on, and what they do."""
    specs = [spec for _, spec in sorted(_discover(plugin).methods.items())]
    if as_json:
        print_json([asdict(spec) for spec in specs])
        return
    rows = table("method", "builds on", "what it does", "reference")
    for spec in specs:
        rows.add_row(spec.name, ", ".join(spec.requires) or "–", spec.summary, spec.reference)
    console().print(rows)


def _discover(plugin: list | None) -> PluginRegistry:
    from apil_core.plugins import discover

    return discover(plugin or [])


def _offers(record: PluginRecord) -> str:
    kinds = {
        "methods": record.methods,
        "games": record.games,
        "policies": record.policies,
        "recorders": record.recorders,
    }
    return "; ".join(f"{kind}: {', '.join(names)}" for kind, names in kinds.items() if names)


def _escaped(text: str) -> str:
    from rich.markup import escape

    return escape(text)
