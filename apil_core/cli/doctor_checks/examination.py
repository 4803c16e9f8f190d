"""All checks in order. None of them may stop the others."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

import apil_core
from apil_core.api.specs import load
from apil_core.cli.doctor_checks.finding import Finding, Report, warning
from apil_core.cli.doctor_checks.scope import Scope
from apil_core.plugins.discovery import PluginRegistry

CHECKS = {
    "python": "apil_core.cli.doctor_checks.interpreter:check",
    "packages": "apil_core.cli.doctor_checks.packages:check",
    "plugins": "apil_core.cli.doctor_checks.plugins:check",
    "presets": "apil_core.cli.doctor_checks.presets:check",
    "cpu": "apil_core.cli.doctor_checks.processor:check",
    "learner and gpu": "apil_core.cli.doctor_checks.learning:check",
    "games": "apil_core.cli.doctor_checks.games:check",
    "drawing": "apil_core.cli.doctor_checks.drawing:check",
    "victims": "apil_core.cli.doctor_checks.weights:check",
    "disk": "apil_core.cli.doctor_checks.disk:check",
}
"""Functions from a :class:`Scope` to findings; lazy, since a check may need what is not installed."""


def examine(
    plugin_files: Sequence[Path] = (),
    *,
    quick: bool = False,
    watch: Callable[[str], None] = lambda name: None,
) -> Report:
    """Look at everything ``apil`` needs.

    Args:
        plugin_files: one-file plugins to look at too; a broken one is a finding.
        quick: leave out what takes seconds: step rates and pictures.
        watch: told the name of each check when it begins.
    """
    registry = PluginRegistry()
    finder = load("apil_core.cli.doctor_checks.plugins:find")
    findings = list(guarded("plugins", lambda: finder(registry, plugin_files)))
    scope = Scope(registry, tuple(plugin_files), quick)
    for name, reference in CHECKS.items():
        watch(name)
        findings += guarded(name, lambda reference=reference: load(reference)(scope))  # type: ignore[misc]
    return Report(version=apil_core.__version__, findings=findings)


def guarded(name: str, check: Callable[[], Iterable[Finding]]) -> Iterator[Finding]:
    """The check's findings; if it breaks, those it had made so far and one that says so."""
    try:
        yield from check()
    except Exception as error:
        reason = " ".join(str(error).split()) or "no message"
        text = f"this check itself failed: {type(error).__name__}: {reason}"
        yield warning(name, text, "see the other lines; if they are fine, please report it")
