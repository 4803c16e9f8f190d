"""Checks of what plugins offer: plugins themselves, presets, games, drawing and victims."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from typing import Any

from apil_core.api.specs import GameSpec
from apil_core.cli.doctor_checks import Finding, Scope
from apil_core.cli.doctor_checks.probes import TrialError, attempt
from apil_core.common.errors import ApilError
from apil_core.config.layers import preset_layer, preset_names
from apil_core.config.resolve import resolve_layers

SECONDS = 1.5
"""Seconds of measurement for each game's rate."""

BACKENDS = {
    "egl": ("EGL", "`apt-get install libegl1`"),
    "osmesa": ("OSMesa", "`apt-get install libosmesa6`"),
    "glfw": ("a screen's OpenGL", "start it where DISPLAY or WAYLAND_DISPLAY names a screen"),
}
"""Values of MUJOCO_GL on Linux, with a description and how to install each."""

_GET = "`apil victims import DIR` or `apil victims download`"


def plugins(scope: Scope) -> Iterator[Finding]:
    """Return one line for the working plugins, and one for each broken one."""
    records = scope.plugins.records
    working = [f"{r.name} {r.version}".strip() for r in records if r.error is None]
    detail = f"{len(working)} of {len(records)} work: {', '.join(working) or 'none'}"
    yield Finding("plugins", "ok", detail)
    for record in records:
        if record.error is not None:
            file = record.origin.startswith("file ")
            what = "mend the file" if file else "mend, upgrade or uninstall its package"
            remedy = f"{what}; the other plugins work without it"
            yield Finding(f"plugin: {record.name}", "warning", f"{record.error} ({record.origin})", remedy)


def presets(scope: Scope) -> Iterator[Finding]:
    """Check that every preset is valid with the working plugins."""
    valid = []
    for name in preset_names():
        try:
            resolve_layers([preset_layer(name)], scope.plugins)
        except ApilError as reason:
            text = " ".join(str(reason).split())
            yield Finding(f"preset: {name}", "warning", text, "use another preset, or reinstall")
        else:
            valid.append(name)
    if valid:
        yield Finding("presets", "ok", f"valid: {', '.join(valid)}")


def games(scope: Scope) -> Iterator[Finding]:
    """Check the step rate of each game; with ``quick``, only that the default one works."""
    specs = scope.games()
    if not any(spec.name == scope.default_game for spec in specs):
        detail = f"{scope.default_game!r}, the game of a plain run, is not offered by any plugin"
        yield Finding("games", "error", detail)
    for spec in specs[:1] if scope.quick else specs:
        yield _game(spec, scope)


def _game(spec: GameSpec, scope: Scope) -> Finding:
    check, seconds = f"game: {spec.name}", 0.0 if scope.quick else SECONDS
    try:
        facts = attempt("play", spec.name, str(seconds), plugin_files=scope.plugin_files)
    except TrialError as reason:
        remedy, asked = "see the lines on packages and plugins", _asked_backend()
        if asked:  # MuJoCo loads it when it is imported, picture or not
            _, install = BACKENDS.get(asked, ("", "set it to egl, osmesa or glfw"))
            remedy = f"unset MUJOCO_GL, or {install}"
        return Finding(check, scope.unless_default(spec.name), str(reason), remedy)
    if scope.quick:
        return Finding(check, "ok", "works (its speed was not measured)")
    rate = facts["rate"]
    minutes = 1e6 / rate / 60
    time = f"{minutes / 60:.1f} h" if minutes >= 90 else f"{minutes:.0f} min" if minutes >= 1 else "seconds"
    detail = f"{rate:,.0f} steps/s with {facts['games']} games at once; a million steps take {time}"
    return Finding(check, "ok", detail)


def drawing(scope: Scope) -> Iterator[Finding]:
    """Draw a game through each back-end, each in a process of its own; one that works is enough."""
    if scope.quick:
        return
    if sys.platform != "linux":
        yield Finding("drawing", "ok", "MuJoCo draws through the system's own OpenGL; nothing to choose")
        return
    failures = {backend: _why_no_picture(backend, scope) for backend in BACKENDS}
    works = [backend for backend, reason in failures.items() if not reason]
    for backend, (what, remedy) in BACKENDS.items():
        check = f"drawing: {backend}"
        if not failures[backend]:
            yield Finding(check, "ok", f"{what} draws {scope.default_game}")
        elif works:
            yield Finding(check, "ok", f"{what} does not work here; not needed, since {works[0]} does")
        else:
            yield Finding(check, "warning", f"{what}: {failures[backend]}", remedy)
    asked = _asked_backend()
    if asked in failures and asked not in works and works:
        detail = f"asks for {asked}, which does not work here, while {', '.join(works)} does"
        yield Finding("drawing: MUJOCO_GL", "warning", detail, "unset MUJOCO_GL")


def _asked_backend() -> str:
    return os.environ.get("MUJOCO_GL", "").lower().strip()


def _why_no_picture(backend: str, scope: Scope) -> str:
    environment = {"MUJOCO_GL": backend}
    try:
        facts = attempt(
            "picture", scope.default_game, plugin_files=scope.plugin_files, environment=environment
        )
    except TrialError as reason:
        return str(reason)
    return "" if facts["shades"] > 1 else "its picture is of one colour"


def victims(scope: Scope) -> Iterator[Finding]:
    """Count the policies of each kind per game; a line for each with a damaged file."""
    try:
        facts = attempt("victims", plugin_files=scope.plugin_files)
    except TrialError as failure:
        remedy = "see the lines on packages and plugins"
        yield Finding("victims", "warning", f"cannot be listed: {failure}", remedy)
        return
    for spec in scope.games():
        if spec.name in facts["auto"]:
            yield _victims_of(spec.name, facts["auto"][spec.name], facts["listed"], scope)
    for name, reason in facts["listed"].items():
        if reason:
            yield Finding(f"victim: {name}", "warning", reason, f"get it again: {_GET}")


def _victims_of(game: str, auto: dict[str, Any], listed: dict[str, str | None], scope: Scope) -> Finding:
    """Check that the victim that ``auto`` means loads; e.g. ``here: zoo 4 of 5, embedded 2 of 2``."""
    states: dict[str, list[str | None]] = {}
    for name, state in listed.items():
        scheme, _, rest = name.partition(":")
        if rest.partition("/")[0] == game:
            states.setdefault(scheme, []).append(state)
    counts = [f"{scheme} {found.count('')} of {len(found)}" for scheme, found in states.items()]
    here = f"here: {', '.join(counts) or 'none listed'}"
    some_missing = any(None in found for found in states.values())
    if not auto["error"]:
        remedy = f"for the others: {_GET}" if some_missing else ""
        return Finding(f"victims: {game}", "ok", f"a run attacks {auto['name']}; {here}", remedy)
    remedy = _GET if some_missing else "name another one with --victim"
    detail = f"a run attacks {auto['name']}, which does not load: {auto['error']}; {here}"
    return Finding(f"victims: {game}", scope.unless_default(game), detail, remedy)
