"""The committed long runs: their page says what they hold, and their agents still play."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from apil_core import evaluate, resume
from apil_core.policies.zoo_import import import_zoo
from apil_core.training.storage.run_dir import RunDir
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


def test_a_long_run_goes_on_under_todays_code(
    tmp_path: Path, zoo_dir: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It was stored before `ppo` and APIL's options had all the keys they have now, and goes on as it was."""
    monkeypatch.setenv("APIL_CACHE", str(tmp_path / "cache"))
    import_zoo(zoo_dir)
    shutil.copytree(ROOT / "docs" / "results" / "long" / "kick-and-defend-e_apil-s0", tmp_path / "r")
    config = tmp_path / "r" / "config.yaml"
    config.write_text(config.read_text().replace("  episodes: 1000", "  episodes: 0"))
    before = RunDir(tmp_path / "r").last_metrics()
    result = resume(tmp_path / "r", steps=before["steps"] + 1)
    after = RunDir(tmp_path / "r").last_metrics()
    assert result.steps == after["steps"] == before["steps"] + 128 * 128
    assert RunDir(tmp_path / "r").config().options["apil"]["imitator"]["credit"] == "return"
    # the published imitator goes on failing as it did: nothing of the new one came in
    error = before["apil/mse"] / before["apil/constant_mse"]
    assert after["apil/relative_error"] == pytest.approx(error, abs=0.1)
