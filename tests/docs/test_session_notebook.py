"""examples/notebook/session.ipynb runs from top to bottom, and its transcript shows the same cells."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from docs.pages import ROOT, blocks

NOTEBOOK = ROOT / "examples" / "notebook" / "session.ipynb"
PAGE = ROOT / "docs" / "results" / "session.md"
CELLS = [cell for cell in json.loads(NOTEBOOK.read_text())["cells"] if cell["cell_type"] == "code"]


def test_it_is_committed_without_outputs() -> None:
    assert not any(cell["outputs"] or cell["execution_count"] for cell in CELLS)


def test_the_transcript_is_of_these_cells_and_small() -> None:
    shown = [block.text for block in blocks(PAGE) if block.language == "python"]
    assert shown == ["".join(cell["source"]) + "\n" for cell in CELLS], "python docs/make_session.py"
    files = [PAGE, *PAGE.with_suffix("").iterdir()]
    assert sum(file.stat().st_size for file in files) < 300_000


@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_it_runs_from_top_to_bottom(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for library in ("nbclient", "ipykernel", "pandas", "optuna", "matplotlib"):
        pytest.importorskip(library, exc_type=ImportError)
    monkeypatch.syspath_prepend(ROOT / "docs")
    done = __import__("make_session").executed(tmp_path)
    texts = "".join(output.get("text", "") for cell in done.cells for output in cell.get("outputs", ()))
    assert "six of ten games won: after" in texts
    assert "adversary.safetensors " in texts
    assert {path.name for path in (tmp_path / "runs").iterdir()} == {"seeds", "stopped", "tuned"}
    assert (tmp_path / "runs" / "tuned" / "best.yaml").is_file()
