"""The page of results says what the runs at home hold, and their agents still play."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from apil_core import evaluate, resume
from apil_core.policies.zoo_import import import_zoo
from apil_core.training.storage.run_dir import RunDir
from docs.pages import ROOT

PAGE = ROOT / "docs" / "results.md"
RESULTS = ROOT / "docs" / "results"
RUNS = sorted(
    file.parent for top in ("campaign/cells", "long") for file in (RESULTS / top).glob("*/*/s*/result.json")
)


def test_every_row_of_the_page_is_what_the_runs_say(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "docs"))
    import make_campaign  # type: ignore[import-not-found]

    made = make_campaign.tables(make_campaign.cells())
    assert len(made) > 20
    written = PAGE.read_text("utf-8").partition(make_campaign.BEGIN)[2].partition(make_campaign.END)[0]
    assert written.split() == "\n".join(made).split()


@pytest.mark.parametrize(
    "run", [run for run in RUNS if run.name == "s0"], ids=lambda path: path.relative_to(RESULTS).as_posix()
)
def test_the_agent_plays(run: Path) -> None:
    """Against a student: the zoo's agent need not be here."""
    pytest.importorskip("onnxruntime")
    config = RunDir(run).config()
    student = config.victim.replace("zoo:", "embedded:")
    score = evaluate(f"onnx:{run / 'adversary.onnx'}", env=config.env, victim=student, episodes=4, threads=1)
    assert sum(score.causes.values()) == 4


def test_a_run_brought_home_is_small_and_has_what_the_page_reads(
    tmp_path: Path, zoo_dir: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("APIL_CACHE", str(tmp_path / "cache"))
    import_zoo(zoo_dir)
    monkeypatch.syspath_prepend(str(ROOT / "docs"))
    import make_campaign

    pytest.importorskip("onnxruntime")
    source = RESULTS / "long" / "kick-and-defend" / "e_apil" / "s0"
    shutil.copytree(source, tmp_path / "run", ignore=shutil.ignore_patterns("adversary.onnx"))
    make_campaign.bring(RunDir(tmp_path / "run"), tmp_path / "home")
    (home,) = (tmp_path / "home").glob("*/*/*")
    assert home.relative_to(tmp_path / "home") == Path("kick-and-defend/e_apil/s0")
    files = {path.name for path in home.rglob("*.*")}
    assert files >= {"adversary.onnx", "config.yaml", "environment.json", "result.json", "metrics.jsonl"}
    assert sum(path.stat().st_size for path in home.rglob("*.*")) <= 1_000_000
    names = [{path.name for path in (place / "scores").iterdir()} for place in (source, home)]
    assert names[0] == names[1]
    # of a longer run at home nothing is lost
    longer = json.loads((home / "result.json").read_text()) | {"steps": 9_000_000}
    (home / "result.json").write_text(json.dumps(longer))
    make_campaign.bring(RunDir(tmp_path / "run"), tmp_path / "home")
    assert json.loads((home / "result.json").read_text())["steps"] == 9_000_000


def test_a_long_run_goes_on_under_todays_code(
    tmp_path: Path, zoo_dir: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It was stored before `ppo` and APIL's options had all the keys they have now, and goes on as it was."""
    monkeypatch.setenv("APIL_CACHE", str(tmp_path / "cache"))
    import_zoo(zoo_dir)
    shutil.copytree(RESULTS / "long" / "kick-and-defend" / "e_apil" / "s0", tmp_path / "r")
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
