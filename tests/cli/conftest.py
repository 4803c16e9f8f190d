"""The command line as a user meets it, with a game of a few numpy lines."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import pytest

from cli.cli_helpers import SMALL, TINY, Apil, called


@pytest.fixture
def apil(capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Apil:
    """Call ``apil ARGUMENTS`` in this process, in an empty directory."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("APIL_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.delenv("APIL_DEBUG", raising=False)

    return partial(called, capsys)


@pytest.fixture
def trained(apil: Apil, tmp_path: Path) -> Path:
    """A finished run of ADRL on the coin game."""
    directory = tmp_path / "trained"
    done = apil("run", *TINY, *SMALL, "--method", "adrl", "--out", directory, "--quiet", "--json")
    assert done.code == 0, done.err
    return directory
