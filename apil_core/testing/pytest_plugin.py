"""Fixtures for the tests of plugins; pytest finds them wherever apil is installed.

Nothing heavy is imported before a fixture is used. ``-p no:apil`` switches them off.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from apil_core.api.config import RunConfig
    from apil_core.runs.session import RunResult
    from apil_core.testing.reports import GameReport, MethodReport, VictimReport


@pytest.fixture
def apil_files(tmp_path: Path) -> Iterator[None]:
    """Unload one-file plugins of the test's directory after the test: their names are module names."""
    before = set(sys.modules)
    yield
    for name in set(sys.modules) - before:
        file = getattr(sys.modules[name], "__file__", None)
        if file is not None and Path(file).resolve().is_relative_to(tmp_path.resolve()):
            del sys.modules[name]


@pytest.fixture
def apil_tiny_run(tmp_path: Path, apil_files: None) -> Callable[..., RunResult]:
    """``apil_tiny_run(config_or_method, plugins=(), **changes)``: train in the test's directory.

    A method's name is completed as by :func:`apil_core.testing.tiny_config`, with ``changes``.
    """
    count = 0

    def train(
        config_or_method: RunConfig | str, plugins: Sequence[str | Path] = (), **changes: Any
    ) -> RunResult:
        from apil_core.testing import tiny_config, tiny_run

        nonlocal count
        count += 1
        config = config_or_method
        if isinstance(config, str):
            config = tiny_config(config, **changes)
        elif changes:
            config = config.model_copy(update=changes)
        return tiny_run(config, tmp_path / f"apil-run-{count}", plugins)

    return train


@pytest.fixture
def apil_check_method(apil_files: None) -> Callable[..., MethodReport]:
    """:func:`apil_core.testing.check_method`."""
    from apil_core.testing import check_method

    return check_method


@pytest.fixture
def apil_check_game(apil_files: None) -> Callable[..., GameReport]:
    """:func:`apil_core.testing.check_game`."""
    from apil_core.testing import check_game

    return check_game


@pytest.fixture
def apil_check_victim(apil_files: None) -> Callable[..., VictimReport]:
    """:func:`apil_core.testing.check_victim`."""
    from apil_core.testing import check_victim

    return check_victim
