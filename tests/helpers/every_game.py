"""All registered games by name, made short: some end and restart within a test."""

from __future__ import annotations

from apil_core import Game
from apil_core.api.specs import load
from apil_core.plugins.registry import default_plugins, make_game

GAME_NAMES = [name for name, spec in default_plugins().games.items() if not spec.family]
"""Families (``scheme:…``) are left out: they are no games by themselves."""


def short_game(name: str, num_envs: int = 1, threads: int = 1, max_steps: int = 20) -> Game:
    """A game that is over after ``max_steps``, if it has that option."""
    model = default_plugins().games[name].config
    limited = model is not None and "max_steps" in load(model).model_fields
    options = {"max_steps": max_steps} if limited else None
    return make_game(name, num_envs=num_envs, threads=threads, options=options)
