"""Python itself."""

from __future__ import annotations

import platform
import sys
from collections.abc import Iterator
from importlib import metadata

from packaging.specifiers import SpecifierSet
from packaging.version import Version

from apil_core.cli.doctor_checks.finding import Finding, error, good, warning
from apil_core.cli.doctor_checks.scope import Scope

DISTRIBUTION = "apil"
NEWEST = "3.13"
"""The newest Python our dependencies were resolved for."""


def check(scope: Scope) -> Iterator[Finding]:
    """Whether this Python is one we support."""
    try:
        wanted = (metadata.metadata(DISTRIBUTION).get_all("Requires-Python") or [""])[0]
    except metadata.PackageNotFoundError:
        wanted = ""  # the check of the packages says so
    yield judge(platform.python_version(), wanted, sys.executable)


def judge(version: str, wanted: str, executable: str) -> Finding:
    """What to say of that Python.

    Args:
        version: e.g. ``"3.11.7"``.
        wanted: what the distribution asks for, e.g. ``">=3.11"``.
        executable: where it is.
    """
    text = f"{version} ({executable})"
    if not SpecifierSet(wanted).contains(version, prereleases=True):
        return error("python", f"{text}, but {wanted} is needed", "make a new environment with that Python")
    if Version(version).release[:2] > Version(NEWEST).release:
        return warning("python", f"{text} is newer than any we looked at", f"if it fails, use {NEWEST}")
    return good("python", text)
