"""A registry of its own for each check, so that what is added to it does not affect others."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from apil_core.api.specs import GameSpec, MethodSpec
from apil_core.common.errors import UnknownNameError
from apil_core.plugins.discovery import PluginRegistry, discover
from apil_core.testing.checks import Subject


def registry_of(
    subject: Subject, spec: MethodSpec | GameSpec | str, plugins: Sequence[str | Path]
) -> PluginRegistry:
    """All installed plugins, those of the files given, and ``spec``; if that is a name, it must be there.

    Raises:
        ContractError: one of the files is broken, or the plugin of that name.
        UnknownNameError: no plugin offers it.
    """
    registry = discover(plugins)
    known = registry.game_names() if subject.kind == "game" else list(registry.methods)
    if isinstance(spec, GameSpec):
        registry.games[spec.name] = spec
    elif isinstance(spec, MethodSpec):
        registry.methods[spec.name] = spec
    elif not (registry.has_game(spec) if subject.kind == "game" else spec in known):
        for record in registry.records:
            text = f"plugin {record.name!r} ({record.origin}) is broken: {record.error}"
            subject.need(record.error is None or record.name != spec, text)
        raise UnknownNameError(subject.kind, spec, known)
    return registry
