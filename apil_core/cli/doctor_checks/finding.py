"""What a check says: one line with a status, and what to do about it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal

from pydantic import BaseModel, computed_field

Status = Literal["ok", "warning", "error"]
"""``error`` is kept for what would keep ``apil run`` from working."""


class Finding(BaseModel):
    """One line of the report.

    Attributes:
        check: what was looked at, ``"subject"`` or ``"subject: part"``.
        status: see :data:`Status`.
        detail: what was found.
        remedy: what would mend it, or what could be added; empty if there is nothing to do.
    """

    check: str
    status: Status
    detail: str
    remedy: str = ""


class Report(BaseModel):
    """What ``apil doctor --json`` prints."""

    version: str
    findings: list[Finding]

    @computed_field  # type: ignore[prop-decorator]  # pydantic's own idiom
    @property
    def status(self) -> Status:
        """The worst of all findings."""
        found = {finding.status for finding in self.findings}
        return "error" if "error" in found else "warning" if "warning" in found else "ok"


def good(check: str, detail: str, remedy: str = "") -> Finding:
    """As it should be; a remedy then names what could be added."""
    return Finding(check=check, status="ok", detail=detail, remedy=remedy)


def warning(check: str, detail: str, remedy: str = "") -> Finding:
    """Something is missing or broken, but ``apil run`` works without it."""
    return Finding(check=check, status="warning", detail=detail, remedy=remedy)


def error(check: str, detail: str, remedy: str = "") -> Finding:
    """``apil run`` would fail."""
    return Finding(check=check, status="error", detail=detail, remedy=remedy)


def listed(names: Iterable[str]) -> str:
    """``"a, b, c"``, or ``"none"``."""
    return ", ".join(names) or "none"
