"""The version of the hook interface: required by plugins, provided here, and deprecation of hooks.

The policy is docs/stability.md.
"""

from __future__ import annotations

import ast
import importlib.util
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from apil_core.common.errors import PluginError, failures

HOOK_API = 2
"""Version of the hooks offered here. A new one comes with every change that can break a plugin."""

OLDEST_HOOK_API = 1
"""Oldest version for which plugins may be built that still work here."""

STATEMENT = "APIL_HOOK_API"
"""Attribute of a plugin's module with the version it was built for."""


class HookDeprecationWarning(DeprecationWarning):
    """A plugin implements a hook, or takes an argument, that will be removed."""


@dataclass(frozen=True)
class Deprecation:
    """The end of a hook or of one of its arguments, as announced.

    Attributes:
        since: hook API version that announced it.
        removed_in: the first version without it.
        instead: what to do, as half a sentence.
    """

    since: int
    removed_in: int
    instead: str

    def warning(self, what: str) -> HookDeprecationWarning:
        """One line about ``what``, e.g. ``"hook 'x'"``."""
        when = f"deprecated since hook API {self.since} and gone in {self.removed_in}"
        return HookDeprecationWarning(f"{what} is {when}: {self.instead}")


@dataclass(frozen=True)
class HookLife:
    """Hook API versions in which a hook exists.

    Attributes:
        since: the version it came with.
        deprecated: its end, if announced.
        deprecated_arguments: ends of arguments, by name.
    """

    since: int
    deprecated: Deprecation | None = None
    deprecated_arguments: tuple[tuple[str, Deprecation], ...] = ()


def stated_version(plugin: Any) -> int | None:
    """The hook API version a plugin's module states, or ``None``.

    Raises:
        PluginError: it is no whole number.
    """
    stated = getattr(plugin, STATEMENT, None)
    if stated is None or (isinstance(stated, int) and not isinstance(stated, bool)):
        return stated
    raise PluginError(f"{STATEMENT} must be a whole number, such as {HOOK_API}, got {stated!r}")


def check_version(name: str, stated: int | None) -> None:
    """Check that a plugin built for this version can work here; a plugin that states none passes.

    Raises:
        PluginError: built for a newer version, or one too old.
    """
    if stated is None or OLDEST_HOOK_API <= stated <= HOOK_API:
        return
    built = f"built for hook API {stated}, this APIL offers {HOOK_API}"
    if stated > HOOK_API:
        raise PluginError(f"{built}: upgrade apil, or install an older {name}")
    raise PluginError(
        f"{built} and nothing older than {OLDEST_HOOK_API}: install a newer {name}, or an older apil"
    )


def version_in_source(place: str | Path) -> int | None:
    """Version stated in the source of a module that fails to import, often as it was built for another one.

    Args:
        place: a file, or a module's name.
    """
    try:
        if isinstance(place, str):
            found = importlib.util.find_spec(place)
            place = Path((found and found.origin) or "")
        statements = ast.parse(place.read_bytes()).body
    except failures():  # looking for a module imports its package, which may raise anything
        return None
    for statement in statements:
        if isinstance(statement, (ast.Assign, ast.AnnAssign)) and isinstance(statement.value, ast.Constant):
            targets = statement.targets if isinstance(statement, ast.Assign) else [statement.target]
            named = any(isinstance(target, ast.Name) and target.id == STATEMENT for target in targets)
            if named and type(statement.value.value) is int:
                return statement.value.value
    return None
