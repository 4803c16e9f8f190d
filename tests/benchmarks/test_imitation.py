"""The offline studies of imitators: games are measured, then learnt from; pages show what was measured."""

from __future__ import annotations

import json
import sys

import pytest
from docs.pages import ROOT
from helpers.small_runs import small_config

from apil_core import run
from apil_core.config.resolve import resolve
from apil_core.plugins.registry import default_plugins

FOLDER = ROOT / "benchmarks" / "imitation"


@pytest.fixture
def recording(tmp_path, monkeypatch):
    monkeypatch.setenv("APIL_RECORDING", str(tmp_path / "games"))
    monkeypatch.syspath_prepend(str(FOLDER))
    config = small_config("adrl", plugins=(str(FOLDER / "recorder.py"),), observers=("recorder",), steps=3072)
    run(config, out=tmp_path / "r")
    return tmp_path / "games"


def test_an_imitator_learns_from_what_was_recorded(recording):
    from study import imitate, table  # type: ignore[import-not-found]

    files = sorted(recording.glob("*.pt"))
    assert len(files) == 6
    config = resolve(flags={"method": "e_apil", "env": "toy-pursuit"}, plugins=default_plugins())
    rows = imitate(config, files)
    again = imitate(config, files)
    assert [row["relative_error"] for row in rows] == [row["relative_error"] for row in again]
    assert rows[-1]["relative_error"] < rows[0]["relative_error"]
    assert "imitator_value_loss_adversary" in rows[-1]
    (line,) = table({"default": rows})
    assert f"{sum(row['relative_error'] for row in rows[-5:]) / 5:.2f} |" in line


def test_memory_is_compared_on_the_same_games(recording, monkeypatch, capsys, tmp_path):
    import memory  # type: ignore[import-not-found]

    monkeypatch.setattr(sys, "argv", ["memory.py", str(recording), "--out", str(tmp_path / "found.json")])
    memory.main()
    assert "LSTM, mean of the last five" in capsys.readouterr().out
    assert (tmp_path / "found.json").is_file()


def test_the_pages_show_what_was_measured(monkeypatch):
    monkeypatch.syspath_prepend(str(FOLDER))
    import study
    import table  # type: ignore[import-not-found]

    results = ROOT / "docs" / "results" / "imitation"
    studied = study.table(json.loads((results / "study.json").read_text()))
    trained = [table.row(found) for found in json.loads((results / "runs.json").read_text())]
    for page, rows in (("methods.md", studied), ("imitation.md", trained)):
        text = (ROOT / "docs" / page).read_text("utf-8").splitlines()
        assert rows
        assert [row for row in rows if row not in text] == []
