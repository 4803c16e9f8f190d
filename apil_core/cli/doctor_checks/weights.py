"""Victims: which are on this machine, and whom a plain run attacks."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from apil_core.cli.doctor_checks.finding import Finding, error, good, warning
from apil_core.cli.doctor_checks.scope import Scope
from apil_core.cli.doctor_checks.trial import TrialError, attempt

_GET = "`apil victims import DIR` or `apil victims download`"

Listed = dict[str, str | None]
"""By a policy's name: ``None`` where its weights are not here, ``""`` where they load, else the reason."""


def check(scope: Scope) -> Iterator[Finding]:
    """Per game, how many policies of each kind are here; a line for each whose file is damaged."""
    try:
        facts = attempt("victims", plugin_files=scope.plugin_files)
    except TrialError as failure:
        yield warning("victims", f"cannot be listed: {failure}", "see the lines on packages and plugins")
        return
    listed: Listed = facts["listed"]
    for spec in scope.games():
        rows = {name: state for name, state in listed.items() if _game_of(name) == spec.name}
        if spec.name in facts["auto"]:
            yield _game(spec.name, facts["auto"][spec.name], rows, scope)
    for name, reason in listed.items():
        if reason:
            yield warning(f"victim: {name}", reason, f"get it again: {_GET}")


def _game(game: str, auto: dict[str, Any], rows: Listed, scope: Scope) -> Finding:
    check, here = f"victims: {game}", f"here: {_counts(rows)}"
    some_missing = None in rows.values()
    if not auto["error"]:
        remedy = f"for the others: {_GET}" if some_missing else ""
        return good(check, f"a run attacks {auto['name']}; {here}", remedy)
    say = error if game == scope.default_game else warning
    remedy = _GET if some_missing else "name another one with --victim"
    return say(check, f"a run attacks {auto['name']}, which does not load: {auto['error']}; {here}", remedy)


def _game_of(name: str) -> str:
    return name.partition(":")[2].partition("/")[0]


def _counts(rows: Listed) -> str:
    """E.g. ``"zoo 4 of 5, embedded 2 of 2"``."""
    schemes = dict.fromkeys(name.partition(":")[0] for name in rows)
    parts = []
    for scheme in schemes:
        states = [state for name, state in rows.items() if name.startswith(f"{scheme}:")]
        parts.append(f"{scheme} {states.count('')} of {len(states)}")
    return ", ".join(parts) or "none listed"
