"""Plugins: which work, and what is wrong with the others."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from apil_core.cli.doctor_checks.finding import Finding, error, good, listed, warning
from apil_core.cli.doctor_checks.scope import Scope
from apil_core.common.errors import PluginError
from apil_core.plugins.discovery import PluginRecord, PluginRegistry, discover


def find(registry: PluginRegistry, files: Sequence[Path]) -> Iterator[Finding]:
    """Fill ``registry``; yields something only if no plugin can be used at all."""
    try:
        found = discover(files, forgiving=True)
    except PluginError as reason:  # APIL_STRICT_PLUGINS=1 asks for it
        yield error("plugins", str(reason), "mend or uninstall it, or unset APIL_STRICT_PLUGINS")
        return
    vars(registry).update(vars(found))


def check(scope: Scope) -> Iterator[Finding]:
    """One line for the working ones, one for each broken one."""
    records = scope.plugins.records
    working = [record for record in records if record.error is None]
    yield good("plugins", f"{len(working)} of {len(records)} work: {listed(_named(r) for r in working)}")
    for record in records:
        if record.error is not None:
            yield warning(f"plugin: {record.name}", f"{record.error} ({record.origin})", _remedy(record))


def _named(record: PluginRecord) -> str:
    return f"{record.name} {record.version}".strip()


def _remedy(record: PluginRecord) -> str:
    what = "mend the file" if record.origin.startswith("file ") else "mend, upgrade or uninstall its package"
    return f"{what}; the other plugins work without it"
