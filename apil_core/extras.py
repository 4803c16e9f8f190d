"""Libraries that only some commands need."""

from __future__ import annotations

import importlib
from types import ModuleType

from apil_core.errors import ApilError


def need(module: str, package: str, purpose: str) -> ModuleType:
    """Import a library.

    Args:
        module: its import name.
        package: its name for pip.
        purpose: what needs it.

    Raises:
        ApilError: it is not installed; says how to install it.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise ApilError(f"{purpose} need {package}: pip install {package}") from error


def need_extra(module: str, extra: str, purpose: str) -> ModuleType:
    """Import a library of an extra of ours.

    Args:
        module: its import name.
        extra: that brings it along.
        purpose: what needs it.

    Raises:
        ApilError: it is not installed; says how to install it.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise ApilError(f"{purpose} need {module}: pip install 'apil[{extra}]'") from error
