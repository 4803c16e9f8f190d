"""The command line in an empty directory, with one-file plugins forgotten after each test."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import pytest
from cli.cli_helpers import Apil as Apil
from cli.cli_helpers import called


@pytest.fixture
def apil(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, forgotten: None
) -> Apil:
    """Call ``apil ARGUMENTS`` in this process."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("APIL_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("COLUMNS", "200")
    return partial(called, capsys)
