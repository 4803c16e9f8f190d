"""Checks of ``apil doctor``, with remedies; a failing check does not stop the others."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, computed_field

import apil_core
from apil_core.api.config import RunConfig
from apil_core.api.specs import GameSpec, load
from apil_core.common.errors import PluginError
from apil_core.plugins.discovery import PluginRegistry, discover

CHECKS = {
    "python": "apil_core.cli.doctor_checks.machine:python",
    "packages": "apil_core.cli.doctor_checks.machine:packages",
    "plugins": "apil_core.cli.doctor_checks.offers:plugins",
    "presets": "apil_core.cli.doctor_checks.offers:presets",
    "cpu": "apil_core.cli.doctor_checks.machine:cpu",
    "learner and gpu": "apil_core.cli.doctor_checks.machine:learner",
    "games": "apil_core.cli.doctor_checks.offers:games",
    "drawing": "apil_core.cli.doctor_checks.offers:drawing",
    "victims": "apil_core.cli.doctor_checks.offers:victims",
    "disk": "apil_core.cli.doctor_checks.machine:disk",
}
"""Functions from a :class:`Scope` to findings; lazy, since a check may need missing packages."""

Status = Literal["ok", "warning", "error"]
"""``error`` is for findings that stop ``apil run`` from working."""


@dataclass(frozen=True)
class Finding:
    """One line of the report.

    Attributes:
        check: what was checked, ``"subject"`` or ``"subject: part"``.
        status: see :data:`Status`.
        detail: the result.
        remedy: a fix, or an optional addition; empty if there is nothing to do.
    """

    check: str
    status: Status
    detail: str
    remedy: str = ""


class Report(BaseModel):
    """Output of ``apil doctor --json``."""

    version: str
    findings: list[Finding]

    @computed_field  # type: ignore[prop-decorator]  # pydantic's own idiom
    @property
    def status(self) -> Status:
        """The worst status of all findings."""
        found = {finding.status for finding in self.findings}
        return "error" if "error" in found else "warning" if "warning" in found else "ok"


@dataclass(frozen=True)
class Scope:
    """Working plugins and requested one-file plugins; ``quick`` skips checks that take seconds.

    A failure of ``default_game``, the game of a plain ``apil run``, is an error.
    """

    plugins: PluginRegistry
    plugin_files: tuple[Path, ...] = ()
    quick: bool = False
    default_game: str = field(default_factory=lambda: RunConfig().env)

    def games(self) -> list[GameSpec]:
        """Games that can be made from their name alone, the default one first; no families."""
        found = [spec for spec in self.plugins.games.values() if not spec.family]
        return sorted(found, key=lambda spec: spec.name != self.default_game)

    def unless_default(self, game: str) -> Status:
        """Status of a failure of ``game``: an error for the default game, a warning for others."""
        return "error" if game == self.default_game else "warning"


def examine(
    plugin_files: Sequence[Path] = (),
    *,
    quick: bool = False,
    watch: Callable[[str], None] = lambda name: None,
) -> Report:
    """Run all checks.

    Args:
        plugin_files: one-file plugins to look at too; a broken one is a finding.
        quick: skip checks that take seconds: step rates and pictures.
        watch: called with the name of each check when it begins.
    """
    plugins, findings = find_plugins(plugin_files)
    scope = Scope(plugins, tuple(plugin_files), quick)
    for name, reference in CHECKS.items():
        watch(name)
        findings += guarded(name, lambda reference=reference: load(reference)(scope))  # type: ignore[misc]
    return Report(version=apil_core.__version__, findings=findings)


def find_plugins(files: Sequence[Path]) -> tuple[PluginRegistry, list[Finding]]:
    """Return the working plugins; or none, and a finding that says why no plugin can be used at all."""
    try:
        return discover(files, forgiving=True), []
    except PluginError as reason:  # raised with APIL_STRICT_PLUGINS=1
        remedy = "mend or uninstall it, or unset APIL_STRICT_PLUGINS"
        return PluginRegistry(), [Finding("plugins", "error", str(reason), remedy)]


def guarded(name: str, check: Callable[[], Iterable[Finding]]) -> Iterator[Finding]:
    """Return the check's findings; if it raises, those so far and one about the error."""
    try:
        yield from check()
    except Exception as error:
        reason = " ".join(str(error).split()) or "no message"
        text = f"this check itself failed: {type(error).__name__}: {reason}"
        yield Finding(name, "warning", text, "see the other lines; if they are fine, please report it")
