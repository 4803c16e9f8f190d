"""Every game, stepped for a moment."""

from __future__ import annotations

import os
from collections.abc import Iterator

from apil_core.api.specs import GameSpec
from apil_core.cli.doctor_checks.drawing import BACKENDS
from apil_core.cli.doctor_checks.finding import Finding, error, good, warning
from apil_core.cli.doctor_checks.scope import Scope
from apil_core.cli.doctor_checks.trial import TrialError, attempt

SECONDS = 1.5
"""How long each game's rate is measured."""


def check(scope: Scope) -> Iterator[Finding]:
    """The step rate of each game; with ``quick``, only whether the default one works at all."""
    games = scope.games()
    if not any(spec.name == scope.default_game for spec in games):
        yield error("games", f"{scope.default_game!r}, the game of a plain run, is not offered by any plugin")
    for spec in games[:1] if scope.quick else games:
        yield _tried(spec, scope)


def _tried(spec: GameSpec, scope: Scope) -> Finding:
    check, seconds = f"game: {spec.name}", 0.0 if scope.quick else SECONDS
    try:
        facts = attempt("play", spec.name, str(seconds), plugin_files=scope.plugin_files)
    except TrialError as reason:
        say = error if spec.name == scope.default_game else warning
        return say(check, str(reason), _remedy())
    if scope.quick:
        return good(check, "works (its speed was not measured)")
    rate = facts["rate"]
    detail = f"{rate:,.0f} steps/s with {facts['games']} games at once; a million steps take {_hours(rate)}"
    return good(check, detail)


def _hours(rate: float) -> str:
    minutes = 1e6 / rate / 60
    return f"{minutes / 60:.1f} h" if minutes >= 90 else f"{minutes:.0f} min" if minutes >= 1 else "seconds"


def _remedy() -> str:
    asked = os.environ.get("MUJOCO_GL", "").lower().strip()
    if asked:  # MuJoCo loads it when it is imported, picture or not
        _, install = BACKENDS.get(asked, ("", "set it to egl, osmesa or glfw"))
        return f"unset MUJOCO_GL, or {install}"
    return "see the lines on packages and plugins"
