"""``safetensors:FILE``: adversaries and students, distinguished by the file's metadata."""

from __future__ import annotations

from safetensors import SafetensorError, safe_open

from apil_core.api.game import SideLayout
from apil_core.api.policy import Policy
from apil_core.common.errors import reason_of
from apil_core.plugins.discovery import PluginRegistry
from apil_core.policies import student
from apil_core.policies.foreign.origin import Origin
from apil_core.training.export import adversary_file


def load(name: str, *, seat: SideLayout | None, plugins: PluginRegistry, device: str) -> Policy:
    """The adversary or student in that file.

    Raises:
        VictimError: there is no such file, it is damaged, or of neither kind.
    """
    return read(Origin.of("safetensors", name), seat=seat, plugins=plugins, device=device)


def read(origin: Origin, *, seat: SideLayout | None, plugins: PluginRegistry, device: str) -> Policy:
    """:func:`load` of a file that is known by another name.

    Raises:
        VictimError: it is damaged, or of neither kind.
    """
    try:
        with safe_open(origin.path, framework="pt") as file:
            found = (file.metadata() or {}).get("format", "none")
    except (SafetensorError, OSError, ValueError) as error:
        raise origin.wrong("a safetensors file", reason_of(error)) from error
    if found == student.FORMAT:
        return student.load_file(origin.path, origin.name)
    if found == adversary_file.FORMAT:
        return adversary_file.load_file(origin, seat=seat, plugins=plugins, device=device)
    raise origin.wrong(f"format {adversary_file.FORMAT!r} or {student.FORMAT!r} in its metadata", repr(found))
