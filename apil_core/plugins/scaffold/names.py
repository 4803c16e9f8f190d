"""The names of a new plugin: as typed, for Python, and in APIL."""

from __future__ import annotations

import importlib.util
import keyword
import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from apil_core.common.errors import ConfigError
from apil_core.plugins.discovery import PluginRegistry

Kind = Literal["method", "game", "victim"]

LONGEST = 30
"""Maximum characters of a name, so that no line of the templates exceeds the line length."""

_WORD = re.compile(r"[a-z][a-z0-9]*([-_][a-z0-9]+)*")


@dataclass(frozen=True)
class Names:
    """Names derived from one name; the same for ``my-attack`` and ``my_attack``.

    Attributes:
        kind: of plugin.
        typed: as the user typed it; also the directory's name.
    """

    kind: Kind
    typed: str

    @property
    def slug(self) -> str:
        """With hyphens, ``my-attack``: games and victims, and the distribution ``apil-my-attack``."""
        return self.typed.replace("_", "-")

    @property
    def identifier(self) -> str:
        """With underscores, ``my_attack``: methods, and the plugin itself."""
        return self.typed.replace("-", "_")

    @property
    def registered(self) -> str:
        """Name for ``--method`` or ``--env``, or the scheme of a victim: spelt like the built-in ones."""
        return self.identifier if self.kind == "method" else self.slug

    @property
    def package(self) -> str:
        """The Python package, ``apil_my_attack``."""
        return f"apil_{self.identifier}"

    @property
    def distribution(self) -> str:
        """Name of the distribution for pip, ``apil-my-attack``."""
        return f"apil-{self.slug}"

    @property
    def camel(self) -> str:
        """Stem of its classes, ``MyAttack``."""
        return "".join(word.capitalize() for word in self.identifier.split("_"))


def new_names(kind: Kind, typed: str, plugins: PluginRegistry) -> Names:
    """The names of a new plugin; none is used by Python or the installed plugins.

    Raises:
        ConfigError: the name is invalid, or taken; the message says by what.
    """
    if not _WORD.fullmatch(typed):
        raise ConfigError(
            f"{typed!r} is no name for a plugin: small letters, digits and single hyphens, "
            f"beginning with a letter, e.g. {_like(typed, kind)!r}"
        )
    if len(typed) > LONGEST:
        raise ConfigError(f"{typed!r} is {len(typed)} characters long; a plugin's name has at most {LONGEST}")
    names = Names(kind, typed)
    _check_offers(names, plugins)
    _check_python(names)
    return names


def _like(typed: str, kind: Kind) -> str:
    """A valid name similar to the typed one."""
    apart = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "-", typed).lower()
    word = re.sub(r"[^a-z0-9]+", "-", apart).strip("-0123456789")[:LONGEST].rstrip("-")
    return word if _WORD.fullmatch(word) and not keyword.iskeyword(word) else f"my-{kind}"


def _check_python(names: Names) -> None:
    if names.identifier in ("null", "true", "false"):
        raise ConfigError(f"{names.typed!r} is a word of YAML's own; try 'my-{names.slug}'")
    if keyword.iskeyword(names.identifier):
        raise ConfigError(f"{names.typed!r} is a word of Python's own; try 'my-{names.slug}'")
    for module in (names.package, names.identifier):
        if _importable(module):
            raise ConfigError(
                f"{names.typed!r}: a Python module {module!r} exists here already; try 'my-{names.slug}'"
            )


def _importable(module: str) -> bool:
    """True if there is a module of that name; a directory alone, which Python accepts too, does not count."""
    try:
        spec = importlib.util.find_spec(module)
    except ValueError:  # of something imported without a spec
        return True
    return spec is not None and spec.origin is not None


def _check_offers(names: Names, plugins: PluginRegistry) -> None:
    """Check that no registered name equals it, hyphens and underscores considered the same."""
    taken: dict[str, Iterable[str]] = {
        "method": (*plugins.methods, *plugins.observers),  # they share the section options
        "game": plugins.games,
        "victim": plugins.policies,
        "plugin": [record.name for record in plugins.records],
    }
    own: tuple[str, ...] = (names.kind, "plugin")
    if names.kind == "game":
        own = (*own, "victim")  # a game has a victim of the same name
    for kind in own:
        for name in taken[kind]:
            if name.replace("-", "_") == names.identifier:
                what = {"victim": "victim scheme"}.get(kind, kind)
                raise ConfigError(f"a {what} named {name!r} exists already; try 'my-{names.slug}'")
