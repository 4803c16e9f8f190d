"""What ``auto`` means: the game's own agent where its weights are on this machine, else the one shipped."""

from __future__ import annotations

from apil_core.plugins import PluginRegistry
from apil_core.specs import GameSpec, load


def default_victim(spec: GameSpec, plugins: PluginRegistry) -> str:
    """Name of the victim a game has unless told otherwise, or ``""``.

    The fallback is taken only where the default is known to be absent: damaged weights are an error
    where they are loaded, and never a reason to attack somebody else.
    """
    if not spec.fallback_victim or is_here(spec.default_victim, plugins):
        return spec.default_victim
    return spec.fallback_victim


def is_here(name: str, plugins: PluginRegistry) -> bool:
    """Whether the policy's weights are on this machine; true for one that no list tells of."""
    scheme = name.partition(":")[0]
    spec = plugins.policies.get(scheme)
    if spec is None or spec.lister is None:
        return True
    rows = {row.name: row.available for row in load(spec.lister)()}
    return rows.get(name, True)
