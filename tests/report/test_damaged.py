"""One damaged file is named, and everything else is listed, reported and run all the same."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from apil_core.studies.bench.cells import resolve_matrix
from apil_core.studies.bench.folder import BenchDir
from apil_core.studies.bench.jobs import JobStatus, make_jobs
from apil_core.studies.bench.schedule import jobs_done
from apil_core.studies.report.report_data import gather
from apil_core.training.storage.run_dir import RunDir
from report.sample import sample_bench

CELL = "cells/kick-and-defend/e_apil"
NOT_UTF8 = b"\xff\xfe\x00\n"
ANOTHER_TYPE = b"[1, [2]]\n"
NESTED = b"[" * 10_000 + b"\n"
WRONG_VALUES = json.dumps({"status": 3, "steps": "x", "evaluation": ["x"]}).encode() + b"\n"
WRONG_INSIDE = json.dumps({"evaluation": {"victim": 3, "win_rate": {"value": "x"}}}).encode() + b"\n"


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    bench = sample_bench(tmp_path_factory.mktemp("bench")).path
    (bench / "activations").mkdir(exist_ok=True)
    (bench / "activations" / "kick-and-defend.json").touch()
    return bench


@pytest.mark.parametrize(
    ("file", "content", "reported", "done"),
    [
        pytest.param(
            f"{CELL}/*/config.yaml", b"steps: 2001-99-99\nversion: 1\n", 13, 17, marks=pytest.mark.slow
        ),
        pytest.param(f"{CELL}/*/result.json", WRONG_VALUES, 13, 15, marks=pytest.mark.slow),
        (f"{CELL}/*/metrics.jsonl", b'{"steps": 1}\n{"steps": "x"}\n', 13, 17),
        pytest.param(f"{CELL}/*/environment.json", NOT_UTF8, 14, 17, marks=pytest.mark.slow),
        (f"{CELL}/*/scores/plain.json", ANOTHER_TYPE, 13, 15),
        pytest.param("baseline/*/scores/plain.json", NOT_UTF8, 14, 16, marks=pytest.mark.slow),
        pytest.param("crossplay/*.json", WRONG_VALUES, 14, 17, marks=pytest.mark.slow),
        pytest.param("activations/*.json", NESTED, 14, 17, marks=pytest.mark.slow),
        pytest.param("retrained/*/*/*/result.json", WRONG_INSIDE, 14, 16, marks=pytest.mark.slow),
        pytest.param("logs/*.failed.json", ANOTHER_TYPE, 14, 17, marks=pytest.mark.slow),
    ],
)
def test_the_rest_is_reported_and_run(
    whole: Path, tmp_path: Path, file: str, content: bytes, reported: int, done: int
) -> None:
    """Of 17 jobs that are done (14 of them finished cells) those count that need not the damaged file."""
    bench = BenchDir(shutil.copytree(whole, tmp_path / "b"))
    damaged = min(bench.path.glob(file))
    damaged.write_bytes(content)
    found = gather([bench.path])
    assert sum(run.status == "finished" for run in found.provenance.runs) == reported
    told = [
        *(warning.text for warning in found.warnings if warning.loud),
        *(each.reason for each in found.unfinished),
        *(each.status for each in (*found.retraining, *found.provenance.runs)),
    ]
    assert any(str(damaged) in text for text in told), told
    benchmark = resolve_matrix(bench.matrix())
    assert len(jobs_done(make_jobs(benchmark), JobStatus(bench, benchmark))) == done


@pytest.mark.parametrize("name", ["result.json", "metrics.jsonl"])
@pytest.mark.parametrize("content", [NOT_UTF8, ANOTHER_TYPE, NESTED, WRONG_VALUES, WRONG_INSIDE])
def test_a_summary_names_the_damaged_file(tmp_path: Path, name: str, content: bytes) -> None:
    (tmp_path / name).write_bytes(content)
    summary = RunDir(tmp_path).summary()
    expected = "empty" if (name, content) == ("metrics.jsonl", NOT_UTF8) else f"{tmp_path / name}"
    assert summary["status"].startswith(expected)
    assert (summary["steps"], summary["evaluation"]) == (0, None)
