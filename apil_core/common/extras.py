"""Libraries that only some commands need."""

from __future__ import annotations

import importlib
from types import ModuleType

from apil_core.common.errors import ApilError


def need(module: str, package: str, purpose: str, *, extra: str = "") -> ModuleType:
    """Import a library.

    Args:
        module: its import name.
        package: its name for pip.
        purpose: what needs it.
        extra: of ours that brings it along, if one does.

    Raises:
        ApilError: it is not installed; says how to install it.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        install = f"'apil[{extra}]'" if extra else package
        raise ApilError(f"{purpose} need {package}: pip install {install}") from error
