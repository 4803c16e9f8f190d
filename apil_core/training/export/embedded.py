"""Policies shipped with APIL: ``embedded:<game>/<role>/<version>``, students named after their teachers and
each game's strongest adversary, ``embedded:<game>/adversary/<version>``."""

from __future__ import annotations

from dataclasses import replace
from importlib.resources import files
from pathlib import Path

from safetensors import SafetensorError, safe_open

from apil_core.api.game import SideLayout
from apil_core.api.policy import Policy
from apil_core.api.specs import PolicyListing
from apil_core.common.errors import UnknownNameError
from apil_core.common.files import sha256
from apil_core.plugins.discovery import PluginRegistry
from apil_core.policies.foreign.origin import Origin
from apil_core.policies.student import provenance_of

SCHEME = "embedded"


def folder() -> Path:
    """Directory of the files: ``<game>/<role>/<version>.safetensors``."""
    return Path(str(files("apil_core.policies"))) / "students"


def known() -> dict[str, Path]:
    """Every shipped policy by its name without the scheme, sorted."""
    found = sorted(folder().glob("*/*/*.safetensors"))
    return {path.relative_to(folder()).with_suffix("").as_posix(): path for path in found}


def list_embedded() -> list[PolicyListing]:
    """Every shipped policy; all are on this machine."""
    return [_listing(name, path) for name, path in known().items()]


def _listing(name: str, path: Path) -> PolicyListing:
    try:
        with safe_open(path, framework="numpy") as file:
            metadata = file.metadata() or {}
    except (SafetensorError, OSError):  # reported when it is loaded
        return PolicyListing(f"{SCHEME}:{name}", True, "", "damaged")
    stated = provenance_of(metadata)
    if "method" in stated:
        source = f"{stated['method']} against {stated['victim']}, {stated['steps']} steps; {stated['score']}"
    else:
        source = f"student of {stated.get('teacher', 'an unknown teacher')}, {stated.get('steps', '?')} steps"
    return PolicyListing(f"{SCHEME}:{name}", True, metadata.get("weights_sha256") or sha256(path), source)


def load(name: str, *, seat: SideLayout | None, plugins: PluginRegistry, device: str) -> Policy:
    """A fresh policy.

    Args:
        name: without the scheme, e.g. ``"kick-and-defend/kicker/v1"``.
        seat: of the policy.
        plugins: registry with an adversary's method.
        device: of an adversary's networks.

    Raises:
        UnknownNameError: there is no such policy.
        VictimError: its file is damaged.
    """
    from apil_core.training.export import safetensors

    if name not in known():
        raise UnknownNameError("victim", f"{SCHEME}:{name}", (f"{SCHEME}:{each}" for each in known()))
    origin = replace(Origin.of(SCHEME, str(known()[name])), name=f"{SCHEME}:{name}")
    return safetensors.read(origin, seat=seat, plugins=plugins, device=device)
