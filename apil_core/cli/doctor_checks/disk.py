"""Room and permission to write."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

from apil_core.cli.doctor_checks.finding import Finding, error, good, warning
from apil_core.cli.doctor_checks.scope import Scope
from apil_core.common.files import why_unwritable
from apil_core.policies.zoo_cache import cache_dir
from apil_core.training.storage.run_dir import DEFAULT_ROOT

ENOUGH = 2**30
"""Bytes below which room is called short."""

_YARDSTICK = "a checkpoint takes 1 to 3 MB and a run keeps two, but metrics and videos grow"


def check(scope: Scope) -> Iterator[Finding]:
    """Where runs and victims' weights go."""
    yield look("disk: runs", DEFAULT_ROOT.absolute(), error, "run it in another folder, or give --out")
    yield look("disk: victims", cache_dir().absolute(), warning, "set APIL_CACHE to a folder of yours")


def look(check: str, folder: Path, say: Callable[[str, str, str], Finding], remedy: str) -> Finding:
    """Whether ``folder`` can be written, or made, and how much room there is.

    Args:
        check: name of the finding.
        folder: absolute path; it need not exist.
        say: how bad it is if nothing can be written there.
        remedy: what to do then.
    """
    place = next(above for above in (folder, *folder.parents) if above.exists())
    reason = why_unwritable(place) if place.is_dir() else f"{place} is a file"
    if reason is not None:
        return say(check, f"{folder} cannot be written: {reason}", remedy)
    free = shutil.disk_usage(place).free
    text = f"{folder}: {free / 2**30:,.1f} GiB free"
    if free < ENOUGH:
        return warning(check, f"{text}; {_YARDSTICK}", "make room")
    return good(check, text)
