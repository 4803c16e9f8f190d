"""The paper's tables as they ship."""

from __future__ import annotations

import json
from importlib import resources
from pathlib import Path

import pytest

from apil_core.studies.report.published import FILE, published

SHARED = Path(__file__).parents[3] / "shared" / "data" / FILE


def test_the_package_has_the_tables() -> None:
    own = published()
    assert own.columns == ["baseline", "adrl", "apl", "apil", "e_apil"]
    assert own.tables[1].value("kick-and-defend", "e_apil") == (0.89, 0.9)
    assert own.tables[2].value("you-shall-not-pass", "baseline") == (0.01, 0.01)
    assert own.tables[4].side == "victim"
    assert (own.episodes, own.adversary_steps, own.retrain_steps) == (1000, 35_000_000, 10_000_000)
    assert own.tables[1].value("toy-pursuit", "adrl") is None


@pytest.mark.skipif(not SHARED.is_file(), reason="the shared data is not beside this checkout")
def test_they_are_the_shared_ones() -> None:
    text = (resources.files("apil_core.studies.report") / FILE).read_text("utf-8")
    assert json.loads(text) == json.loads(SHARED.read_text("utf-8"))


def test_all_cells_are_there() -> None:
    for table in published().tables.values():
        assert list(table.rows) == published().games
        assert all(list(row) == published().columns for row in table.rows.values())
