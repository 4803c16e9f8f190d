"""The command line as a user meets it, with a game of a few numpy lines."""

from __future__ import annotations

from pathlib import Path

import pytest

from apil_core.cli import main
from cli.cli_helpers import SMALL, TINY, Apil, Outcome


@pytest.fixture
def apil(capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Apil:
    """Call ``apil ARGUMENTS`` in this process, in an empty directory."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("APIL_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.delenv("APIL_DEBUG", raising=False)

    def call(*arguments: str | Path) -> Outcome:
        capsys.readouterr()
        with pytest.raises(SystemExit) as caught:
            main([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        return Outcome(int(caught.value.code or 0), captured.out, captured.err)

    return call


@pytest.fixture
def trained(apil: Apil, tmp_path: Path) -> Path:
    """A finished run of ADRL on the coin game."""
    directory = tmp_path / "trained"
    done = apil("run", *TINY, *SMALL, "--method", "adrl", "--out", directory, "--quiet", "--json")
    assert done.code == 0, done.err
    return directory
