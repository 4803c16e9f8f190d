"""Conformance checks for plugin authors: that a method, a game or a victim meets the core's contract.

Names load lazily, so importing this package brings in neither torch nor mujoco. docs/testing.md lists
every check.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

_HOME_OF = {
    "ContractError": "apil_core.testing.checks",
    "GameReport": "apil_core.testing.reports",
    "MethodReport": "apil_core.testing.reports",
    "VictimReport": "apil_core.testing.reports",
    "check_game": "apil_core.testing.games",
    "check_method": "apil_core.testing.methods",
    "check_victim": "apil_core.testing.victims",
    "tiny_config": "apil_core.testing.tiny",
    "tiny_run": "apil_core.testing.tiny",
}

__all__ = list(_HOME_OF)


def __getattr__(name: str) -> Any:
    if name not in _HOME_OF:
        raise AttributeError(f"module 'apil_core.testing' has no attribute {name!r}")
    value = getattr(importlib.import_module(_HOME_OF[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return list(__all__)


if TYPE_CHECKING:
    from apil_core.testing.checks import ContractError as ContractError
    from apil_core.testing.games import check_game as check_game
    from apil_core.testing.methods import check_method as check_method
    from apil_core.testing.reports import GameReport as GameReport
    from apil_core.testing.reports import MethodReport as MethodReport
    from apil_core.testing.reports import VictimReport as VictimReport
    from apil_core.testing.tiny import tiny_config as tiny_config
    from apil_core.testing.tiny import tiny_run as tiny_run
    from apil_core.testing.victims import check_victim as check_victim
