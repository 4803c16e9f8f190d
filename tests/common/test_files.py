"""Locks, and directories that are free to be written to."""

from __future__ import annotations

from pathlib import Path

import pytest

from apil_core import ConfigError, RunDirError
from apil_core.common.files import is_taken, locked


def test_a_lock_is_held_by_one_at_a_time(tmp_path: Path) -> None:
    lock = tmp_path / ".lock"
    with locked(lock, "first"):
        with pytest.raises(RunDirError, match="^somebody is here$"), locked(lock, "somebody is here"):
            pass
        with pytest.raises(ConfigError, match="^busy$"), locked(lock, "busy", ConfigError, patience=0.01):
            pass
    with locked(lock, "again"):
        pass


def test_a_lock_is_let_go_by_what_fails(tmp_path: Path) -> None:
    with pytest.raises(ZeroDivisionError), locked(tmp_path / ".lock", "first"):
        raise ZeroDivisionError
    with locked(tmp_path / ".lock", "second"):
        pass


def test_what_is_taken(tmp_path: Path) -> None:
    assert not is_taken(tmp_path / "nothing")
    assert not is_taken(tmp_path)
    (tmp_path / "file").touch()
    assert is_taken(tmp_path)
    assert is_taken(tmp_path / "file")
