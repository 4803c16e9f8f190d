"""The students shipped with APIL: ``embedded:<game>/<role>/<version>``, named after their teachers."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

from safetensors import SafetensorError, safe_open

from apil_core.api.specs import PolicyListing
from apil_core.common.errors import UnknownNameError
from apil_core.policies.student import provenance_of

if TYPE_CHECKING:
    from apil_core.policies.frozen_policy import FrozenPolicy

SCHEME = "embedded"


def folder() -> Path:
    """Directory of the files: ``<game>/<role>/<version>.safetensors``."""
    return Path(str(files(__package__))) / "students"


def known() -> dict[str, Path]:
    """Every student by its name without the scheme, sorted."""
    found = sorted(folder().glob("*/*/*.safetensors"))
    return {path.relative_to(folder()).with_suffix("").as_posix(): path for path in found}


def list_embedded() -> list[PolicyListing]:
    """Every student; all are on this machine."""
    return [_listing(name, path) for name, path in known().items()]


def _listing(name: str, path: Path) -> PolicyListing:
    try:
        with safe_open(path, framework="numpy") as file:
            metadata = file.metadata() or {}
    except (SafetensorError, OSError):  # reported when it is loaded
        metadata = {}
    stated = provenance_of(metadata)
    source = f"student of {stated.get('teacher', 'an unknown teacher')}, {stated.get('steps', '?')} steps"
    return PolicyListing(f"{SCHEME}:{name}", True, metadata.get("weights_sha256", ""), source)


def load(name: str) -> FrozenPolicy:
    """A fresh policy on the CPU.

    Args:
        name: without the scheme, e.g. ``"kick-and-defend/kicker/v1"``.

    Raises:
        UnknownNameError: there is no such student.
        VictimError: its file is damaged.
    """
    from apil_core.policies.student import load_file

    if name not in known():
        raise UnknownNameError("victim", f"{SCHEME}:{name}", (f"{SCHEME}:{each}" for each in known()))
    return load_file(known()[name], f"{SCHEME}:{name}")
