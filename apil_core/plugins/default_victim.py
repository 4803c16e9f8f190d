"""Default players of a game: its own agents if their weights are on this machine, else the shipped ones."""

from __future__ import annotations

from pathlib import Path

from apil_core.api.specs import GameSpec, PolicyListing, PolicySpec, load
from apil_core.common.errors import ApilError, UnknownNameError
from apil_core.plugins.discovery import PluginRegistry
from apil_core.plugins.registry import load_policy

BASELINES = ("random", "zero")
"""Names without a scheme: the baseline of that kind in the seat's sizes."""


def default_victim(spec: GameSpec, plugins: PluginRegistry) -> str:
    """Name of a game's default victim, or ``""``.

    The fallback is used only where the default is known to be absent: damaged weights are an error
    when they are loaded, and never a reason to attack another victim.
    """
    if not spec.fallback_victim or is_here(spec.default_victim, plugins):
        return spec.default_victim
    return spec.fallback_victim


def is_here(name: str, plugins: PluginRegistry) -> bool:
    """True if the policy's weights are on this machine, or if no lister lists the policy."""
    scheme = name.partition(":")[0]
    spec = plugins.policies.get(scheme)
    if spec is None or spec.lister is None:
        return True
    return {row.name: row.available for row in listings(spec)}.get(name, True)


def why_absent(name: str, plugins: PluginRegistry) -> str:
    """Reason why there is no such policy, or ``""``; runs no user code and checks no weights."""
    scheme, colon, rest = name.partition(":")
    if not colon:
        known = name in (*BASELINES, "auto") or Path(name).is_dir()
        return "" if known else f"{name} is neither a directory nor a policy's name like zoo:GAME/ROLE/v1"
    spec = plugins.policies.get(scheme)
    if spec is None:
        return str(UnknownNameError("policy", name, [f"{known}:…" for known in plugins.policies]))
    if spec.file and not Path(rest).expanduser().exists():
        return f"{name}: {rest}: no such file"
    if spec.lister and name not in {row.name for row in listings(spec) if row.available}:
        try:
            load_policy(name, plugins=plugins)  # the error states what is wrong and how to get the weights
        except ApilError as error:
            return str(error)
    return ""


def default_baseline(spec: GameSpec, plugins: PluginRegistry) -> str:
    """Name of the agent an adversary is compared with, or ``""`` where the game has none on this machine.

    The game's baseline; else its substitute in the game's matchups; else the shipped student of either.
    """
    own = spec.baseline_adversary
    if own is None:
        return ""
    stand_ins = [pair.adversary for pair in spec.matchups if pair.stands_in_for == own]
    students = [f"embedded:{name.partition(':')[2]}" for name in (own, *stand_ins)]
    # a student's name is made up here, so it must be on a list, not merely on none
    embedded = plugins.policies.get("embedded")
    listed = {row.name for row in (listings(embedded) if embedded else ())}
    known = [name for name in (own, *stand_ins) if is_here(name, plugins)]
    return next(iter([*known, *(name for name in students if name in listed)]), "")


def listings(spec: PolicySpec) -> list[PolicyListing]:
    """The policies of a scheme; if its lister fails, one row with the reason."""
    try:
        rows = list(load(spec.lister)()) if spec.lister else []
        odd = [row for row in rows if not isinstance(row, PolicyListing)]
        if odd:
            raise TypeError(f"its lister gives {odd[0]!r}, which is no PolicyListing")
        return rows
    except Exception as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        return [PolicyListing(f"{spec.scheme}:…", available=False, provenance=f"cannot be listed: {reason}")]
