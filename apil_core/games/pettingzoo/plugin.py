"""Registers the family of games ``pettingzoo:module:callable``. Imports neither torch nor PettingZoo."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from apil_core.api.hooks import hookimpl
from apil_core.api.specs import GameSpec

APIL_HOOK_API = 2

_FAMILY = GameSpec(
    name="pettingzoo",
    factory="apil_core.games.pettingzoo.game:PettingZooGame",
    summary="any PettingZoo ParallelEnv of two agents: pettingzoo:MODULE:CALLABLE",
    sides=("first agent", "second agent"),
    config="apil_core.games.pettingzoo.options:PettingZooOptions",
    family=True,
)


@hookimpl
def register_games() -> list[GameSpec]:
    """One spec for every environment there is."""
    return [_FAMILY]


def pettingzoo_spec(target: str, **fields: Any) -> GameSpec:
    """The spec of one PettingZoo environment, for plugins that register its sides and its victim.

    Args:
        target: ``"module:callable"``.
        fields: of :class:`apil_core.GameSpec`, e.g. ``victim_side``; ``config`` should name a subclass of
            :class:`apil_core.PettingZooOptions`. Default name: ``pettingzoo:<target>``.
    """
    return replace(_FAMILY, **{"name": f"pettingzoo:{target}", "family": False, "target": target, **fields})
