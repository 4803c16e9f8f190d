"""The seat a new victim is for."""

from __future__ import annotations

from dataclasses import dataclass

from apil_core.api.game import SideLayout
from apil_core.plugins.discovery import PluginRegistry
from apil_core.plugins.registry import game_spec, named_side


@dataclass(frozen=True)
class Seat:
    """One side of one game.

    Attributes:
        env: the game.
        side: sizes of its observation and action.
        index: 0 or 1.
        attacked: whether that side is attacked by default.
        rival: the game's default victim if it plays this side, else empty.
    """

    env: str
    side: SideLayout
    index: int
    attacked: bool
    rival: str

    @property
    def hand_made(self) -> bool:
        """True if the template has trained weights: for toy-pursuit's evader only."""
        return (self.env, self.side.name) == ("toy-pursuit", "evader")


def find_seat(env: str, side: str | None, plugins: PluginRegistry) -> Seat:
    """The named side of a game, or the attacked one.

    Raises:
        UnknownNameError: there is no such game, or it has no such side.
    """
    spec = game_spec(env, plugins)
    layout, index = named_side(env, side, plugins)
    attacked = index == spec.victim_side
    return Seat(env, layout.sides[index], index, attacked, "auto" if attacked and spec.default_victim else "")
