"""What an examination covers."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from apil_core.api.config import RunConfig
from apil_core.api.specs import GameSpec
from apil_core.plugins.discovery import PluginRegistry


@dataclass(frozen=True)
class Scope:
    """Given to every check.

    Attributes:
        plugins: what working plugins offer.
        plugin_files: one-file plugins asked for.
        quick: leave out what takes seconds.
        default_game: the game of a plain ``apil run``; what breaks it is an error.
    """

    plugins: PluginRegistry
    plugin_files: tuple[Path, ...] = ()
    quick: bool = False
    default_game: str = field(default_factory=lambda: RunConfig().env)

    def games(self) -> list[GameSpec]:
        """The games that can be made from their name alone, the default one first; no families."""
        found = [spec for spec in self.plugins.games.values() if not spec.family]
        return sorted(found, key=lambda spec: spec.name != self.default_game)
