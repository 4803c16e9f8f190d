"""Packages as ``apil new`` writes them, for tests."""

from __future__ import annotations

from pathlib import Path

from apil_core.plugins.registry import default_plugins
from apil_core.plugins.scaffold.names import Kind, new_names
from apil_core.plugins.scaffold.package import Written, write_package
from apil_core.plugins.scaffold.seat import find_seat

KINDS: tuple[Kind, ...] = ("method", "game", "victim")


def write(kind: Kind, typed: str, folder: Path, env: str = "toy-pursuit", side: str | None = None) -> Written:
    """A new package in ``folder``."""
    plugins = default_plugins()
    names = new_names(kind, typed, plugins)
    seat = find_seat(env, side, plugins) if kind == "victim" else None
    return write_package(names, folder / typed, seat)


def write_all(stem: str, folder: Path) -> dict[Kind, Written]:
    """``<stem>-method``, ``<stem>-game`` and ``<stem>-victim``."""
    return {kind: write(kind, f"{stem}-{kind}", folder) for kind in KINDS}
