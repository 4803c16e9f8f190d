"""``apil plugins | games | methods | observers``: what is installed, and why something does not work."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from apil_core.cli.flags import Json, Plugins
from apil_core.cli.output import console, emit, print_json, styled, table

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
    columns = ("plugin", "version", "hook API", "offers", "hooks", "origin")
    _list(records, as_json, columns, _row)
    return int(any(record.error for record in records))


def games(*, plugin: Plugins | None = None, as_json: Json = False) -> None:
    """List games: sides, default victim on this machine, and what they are."""
    from apil_core.plugins.default_victim import default_victim

    plugins = _discover(plugin)
    specs = [spec for _, spec in sorted(plugins.games.items())]
    if as_json:
        print_json([{**asdict(spec), "victim_here": default_victim(spec, plugins)} for spec in specs])
        return
    _list(
        specs,
        as_json,
        ("game", "attacked side", "adversary", "default victim", "what it is"),
        lambda spec: (
            *(spec.label, spec.sides[spec.victim_side], spec.sides[1 - spec.victim_side]),
            *(default_victim(spec, plugins) or "–", spec.summary),
        ),
    )


def methods(*, plugin: Plugins | None = None, as_json: Json = False) -> None:
    """List attack methods: what they build on, and what they do."""
    specs = [spec for _, spec in sorted(_discover(plugin).methods.items())]
    columns = ("method", "builds on", "what it does", "reference")
    _list(
        specs,
        as_json,
        columns,
        lambda spec: (spec.name, ", ".join(spec.requires) or "–", spec.summary, spec.reference),
    )


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
    columns = ("observer", "what it does", "reference")
    _list(specs, as_json, columns, lambda spec: (spec.name, spec.summary, spec.reference))


def _list(
    found: Sequence[Any],
    as_json: bool,
    columns: Sequence[str],
    row: Callable[[Any], Sequence[str | Text]],
) -> None:
    emit(found, as_json, lambda: console().print(table(*columns, rows=map(row, found))))


def _row(record: PluginRecord) -> Sequence[str | Text]:
    offers = styled(record.error, "red") if record.error else _offers(record)
    stated = _stated(record.hook_api)
    return record.name, record.version, stated, offers, ", ".join(record.hooks), record.origin


def _checked(plugin: list | None, as_json: bool) -> int:
    from apil_core.plugins.check import check_plugins
    from apil_core.plugins.discovery import discover

    reports = check_plugins(discover(plugin or [], forgiving=True))
    if as_json:
        print_json(reports)
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
    kinds = ("methods", "observers", "games", "policies", "recorders")
    offered = {kind: ", ".join(getattr(record, kind)) for kind in kinds}
    return "; ".join(f"{kind}: {names}" for kind, names in offered.items() if names)
