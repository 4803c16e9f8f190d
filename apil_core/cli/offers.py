"""``apil plugins | games | methods | observers``: what is installed, and why something does not work."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from apil_core.cli.flags import Json, Plugins
from apil_core.cli.output import console, print_json, styled, table

if TYPE_CHECKING:
    from rich.text import Text

    from apil_core.plugins.check import PluginReport
    from apil_core.plugins.discovery import PluginRecord, PluginRegistry

_Check = Annotated[
    bool, Parameter(name="--check", negative=(), help="Load all they name and compare their hooks.")
]


def plugins(*, plugin: Plugins | None = None, check: _Check = False, as_json: Json = False) -> int:
    """List plugins: name, version, origin, hooks and offers; a broken one with its error.

    Exit code 1 if any plugin is broken.
    """
    if check:
        return _checked(plugin, as_json)
    records = _discover(plugin).records
    if as_json:
        print_json([asdict(record) for record in records])
    else:
        rows = table("plugin", "version", "hook API", "offers", "hooks", "origin")
        for record in records:
            offers = styled(record.error, "red") if record.error else _offers(record)
            stated = _stated(record.hook_api)
            rows.add_row(record.name, record.version, stated, offers, ", ".join(record.hooks), record.origin)
        console().print(rows)
    return int(any(record.error for record in records))


def games(*, plugin: Plugins | None = None, as_json: Json = False) -> None:
    """List games: sides, default victim on this machine, and what they are."""
    from apil_core.plugins.default_victim import default_victim

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


def observers(*, plugin: Plugins | None = None, as_json: Json = False) -> None:
    """List observers: what can be switched on beside a method with --set observers=[NAME].

    Also by apil eval --observer NAME; plugins that fill run hooks themselves are observers, too.
    """
    from apil_core.api.specs import ObserverSpec

    found = _discover(plugin)
    of_modules = {
        name: ObserverSpec(name, "", "run hooks of the plugin of that name") for name in found.modules
    }
    specs = [{**of_modules, **found.observers}[name] for name in sorted(found.observer_names())]
    if as_json:
        print_json([asdict(spec) for spec in specs])
        return
    rows = table("observer", "what it does", "reference")
    for spec in specs:
        rows.add_row(spec.name, spec.summary, spec.reference)
    console().print(rows)


def _checked(plugin: list | None, as_json: bool) -> int:
    from apil_core.plugins.check import check_plugins
    from apil_core.plugins.discovery import discover

    reports = check_plugins(discover(plugin or [], forgiving=True))
    if as_json:
        print_json([asdict(report) for report in reports])
    else:
        for line in (line for report in reports for line in _lines(report)):
            console().print(*line, sep="")
    return int(any(report.broken for report in reports))


def _lines(report: PluginReport) -> Iterator[tuple[Text, str]]:
    """Return one line per working plugin, per reason why one does not work, and per remark."""
    for reason in report.broken:
        yield styled("broken", "red"), f"  {report.name}: {reason}"
    if not report.broken:
        version = f"{report.name} {report.version}".strip()
        yield styled("works", "green"), f"   {version} (hook API {_stated(report.hook_api)})"
    for remark in report.remarks:
        yield styled("remark", "yellow"), f"  {report.name}: {remark}"


def _stated(version: int | None) -> str:
    return "not stated" if version is None else str(version)


def _discover(plugin: list | None) -> PluginRegistry:
    from apil_core.plugins.discovery import discover

    return discover(plugin or [])


def _offers(record: PluginRecord) -> str:
    kinds = {
        "methods": record.methods,
        "observers": record.observers,
        "games": record.games,
        "policies": record.policies,
        "recorders": record.recorders,
    }
    return "; ".join(f"{kind}: {', '.join(names)}" for kind, names in kinds.items() if names)
