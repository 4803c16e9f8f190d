"""The committed long runs: their page says what they hold, and their agents still play."""

from __future__ import annotations

from pathlib import Path

import pytest

from apil_core import evaluate
from apil_core.rundir import RunDir
from docs.pages import ROOT

PAGE = ROOT / "docs" / "long-runs.md"
RUNS = sorted((ROOT / "docs" / "results" / "long").glob("*-s0"))


def test_every_row_of_the_page_is_what_the_runs_say(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "docs"))
    from make_runs import print_tables  # type: ignore[import-not-found]

    print_tables([RunDir(path) for path in RUNS])
    printed = [line for line in capsys.readouterr().out.splitlines() if line.startswith("| ")]
    assert len(printed) > 10
    text = PAGE.read_text("utf-8").splitlines()
    assert [line for line in printed if line not in text] == []


@pytest.mark.parametrize("run", RUNS, ids=lambda path: path.name)
def test_the_agent_plays(run: Path) -> None:
    """Against a student: the zoo's agent need not be here."""
    score = evaluate(run, episodes=4, victim="embedded:kick-and-defend/kicker/v1", threads=1)
    assert score.trained_steps is not None
    assert score.trained_steps > 8_000_000
    assert sum(score.causes.values()) == 4
