"""Pictures: which OpenGL MuJoCo can draw with here."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator

from apil_core.cli.doctor_checks.finding import Finding, good, warning
from apil_core.cli.doctor_checks.scope import Scope
from apil_core.cli.doctor_checks.trial import TrialError, attempt

BACKENDS = {
    "egl": ("EGL", "`apt-get install libegl1`"),
    "osmesa": ("OSMesa", "`apt-get install libosmesa6`"),
    "glfw": ("a screen's OpenGL", "start it where DISPLAY or WAYLAND_DISPLAY names a screen"),
}
"""Values of MUJOCO_GL on Linux: what each is, and how to get it."""


def check(scope: Scope) -> Iterator[Finding]:
    """Draw a game through each back-end, each in a process of its own; one that works is enough."""
    if scope.quick:
        return
    if sys.platform != "linux":
        yield good("drawing", "MuJoCo draws through the system's own OpenGL; nothing to choose")
        return
    name = scope.default_game
    failures = {backend: _why_not(backend, name, scope) for backend in BACKENDS}
    works = [backend for backend, reason in failures.items() if not reason]
    asked = os.environ.get("MUJOCO_GL", "").lower().strip()
    for backend, (what, remedy) in BACKENDS.items():
        reason = failures[backend]
        check = f"drawing: {backend}"
        if not reason:
            yield good(check, f"{what} draws {name}")
        elif works:
            yield good(check, f"{what} does not work here; not needed, since {works[0]} does")
        else:
            yield warning(check, f"{what}: {reason}", remedy)
    if asked in failures and asked not in works and works:
        detail = f"asks for {asked}, which does not work here, while {', '.join(works)} does"
        yield warning("drawing: MUJOCO_GL", detail, "unset MUJOCO_GL")


def _why_not(backend: str, game: str, scope: Scope) -> str:
    try:
        facts = attempt("picture", game, plugin_files=scope.plugin_files, environment={"MUJOCO_GL": backend})
    except TrialError as reason:
        return str(reason)
    return "" if facts["shades"] > 1 else "its picture is of one colour"
