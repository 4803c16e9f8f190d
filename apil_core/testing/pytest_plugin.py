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


def _check(name: str) -> Callable[..., Callable[..., Any]]:
    """The fixture of a check, which unloads one-file plugins afterwards."""

    def check(apil_files: None) -> Callable[..., Any]:
        import apil_core.testing

        found: Callable[..., Any] = getattr(apil_core.testing, name)
        return found

    check.__doc__ = f":func:`apil_core.testing.{name}`."
    return pytest.fixture(check, name=f"apil_{name}")


apil_check_method = _check("check_method")
apil_check_game = _check("check_game")
apil_check_victim = _check("check_victim")
