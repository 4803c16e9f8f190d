"""Real benchmarks on the toy game: what is run, kept, resumed, reported."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from apil_core.bench.cells import resolve_matrix
from apil_core.bench.executor import LocalProcesses
from apil_core.bench.folder import BenchDir, score_path
from apil_core.bench.jobs import Ledger, make_jobs
from apil_core.bench.matrix import Matrix
from apil_core.bench.schedule import Course, Watch, run_jobs
from apil_core.bench.work import perform
from apil_core.cli import main
from apil_core.recorders import read_metrics
from bench.small_matrix import small_matrix

CELL = "cells/toy-pursuit/adrl/s0-3072"


def made(root: Path, matrix: Matrix) -> Ledger:
    benchmark = resolve_matrix(matrix)
    bench = BenchDir(root)
    bench.write_matrix(benchmark.matrix)
    return Ledger(bench, benchmark)


def test_a_job_does_what_is_missing_and_no_more(tmp_path: Path):
    ledger = made(tmp_path / "b", small_matrix())
    job = make_jobs(ledger.benchmark)[0]
    assert job.name == CELL
    assert not ledger.is_done(job)
    assert perform(ledger.bench.path, CELL) == "done"
    assert ledger.is_done(job)
    run = ledger.bench.cell(job.subject)
    before = {path: path.stat().st_mtime_ns for path in run.path.rglob("*.json*")}
    assert perform(ledger.bench.path, CELL) == "done"
    assert {path: path.stat().st_mtime_ns for path in run.path.rglob("*.json*")} == before

    score = ledger.bench.cells()[0].score("plain")
    assert (score.episodes, score.trained_steps, score.blind) == (20, 3072, None)
    # more games are asked for now: played anew, the training is kept
    more = made(ledger.bench.path, small_matrix(scores={"plain": {"episodes": 30}}))
    assert not more.is_done(job)
    perform(ledger.bench.path, CELL)
    assert more.bench.cells()[0].score("plain").episodes == 30
    assert [row["steps"] for row in read_metrics(run.metrics_path)] == [512 * i for i in range(1, 7)]

    # and a damaged score is told, not played over
    score_path(run.path, "plain").write_text("{")
    with pytest.raises(Exception, match=r"plain\.json is damaged"):
        more.is_done(job)


def test_a_larger_budget_is_another_cell_and_other_settings_are_refused(tmp_path: Path):
    ledger = made(tmp_path / "b", small_matrix())
    perform(ledger.bench.path, CELL)
    config = {**small_matrix().config, "num_envs": 16}
    path = tmp_path / "changed.yaml"
    path.write_text(json.dumps({**small_matrix().model_dump(mode="json"), "config": config}))
    with pytest.raises(SystemExit) as caught:
        main(["bench", "run", str(path), "--out", str(ledger.bench.path), "--quiet"])
    assert caught.value.code == 2


def test_a_failing_cell_does_not_stop_the_others(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """A plugin that raises in its third iteration, beside a sound method; then the plugin is mended."""
    plugin = tmp_path / "shaky.py"
    text = """
from apil_core import Method, MethodSpec, hookimpl

class Shaky(Method):
    @hookimpl
    def update_auxiliary(self, run, rollout):
        if run.iteration == 2:
            raise RuntimeError("the third iteration is too much")

@hookimpl
def register_methods():
    return [MethodSpec(name="shaky", factory="shaky:Shaky")]
"""
    plugin.write_text(text)
    config = {**small_matrix().config, "plugins": [str(plugin)]}
    matrix = tmp_path / "m.yaml"
    matrix.write_text(
        json.dumps({**small_matrix(methods=["shaky", "adrl"], config=config).model_dump(mode="json")})
    )
    call = ["bench", "run", str(matrix), "--out", str(tmp_path / "b"), "--quiet", "--json", "--workers", "2"]
    with pytest.raises(SystemExit) as caught:
        main(call)
    assert caught.value.code == 1
    told = json.loads(capsys.readouterr().out)
    assert told["jobs"] == {"cells/toy-pursuit/shaky/s0-3072": "failed", CELL: "done"}
    assert "the third iteration is too much" in told["failures"]["cells/toy-pursuit/shaky/s0-3072"]

    plugin.write_text(text.replace("run.iteration == 2", "False"))
    with pytest.raises(SystemExit) as caught:
        main(call)
    told = json.loads(capsys.readouterr().out)
    assert (caught.value.code, told["kept"], told["failures"]) == (0, [CELL], {})
    # the shaky cell went on from its checkpoint after two iterations
    sessions = json.loads((tmp_path / "b/cells/toy-pursuit/shaky/s0-3072/environment.json").read_text())
    assert len(sessions) == 2


class _StopAt(Watch):
    """Presses Ctrl-C once the run has so many rows."""

    def __init__(self, path: Path, rows: int):
        self.path, self.rows, self.pressed = path, rows, False

    def update(self, states: dict) -> None:
        lines = self.path.read_text().count("\n") if self.path.is_file() else 0
        if not self.pressed and lines >= self.rows:
            self.pressed = True
            raise KeyboardInterrupt


def test_interrupted_anywhere_it_ends_like_one_that_was_not(tmp_path: Path):
    matrix = small_matrix(steps=40 * 512)
    whole = made(tmp_path / "whole", matrix)
    name = make_jobs(whole.benchmark)[0].name
    perform(whole.bench.path, name)

    ledger = made(tmp_path / "broken", matrix)
    run = ledger.bench.cell(name.partition("/")[2])
    course = _go(ledger, _StopAt(run.metrics_path, 2))
    assert course.interrupted
    assert course.states[name] == "interrupted"
    assert _go(ledger, Watch()).states == {name: "done"}
    again = _go(ledger, Watch())
    assert again.kept == (name,)
    reference = whole.bench.cell(name.partition("/")[2])
    times = {"wall_seconds", "steps_per_second", "collect_seconds", "update_seconds", "memory_mb"}
    rows, expected = (
        [{k: v for k, v in row.items() if k not in times} for row in read_metrics(path)]
        for path in (run.metrics_path, reference.metrics_path)
    )
    assert rows == expected
    scores = [json.loads(score_path(r.path, "plain").read_text())["wins"] for r in (run, reference)]
    assert scores[0] == scores[1]


def _go(ledger: Ledger, watch: Watch) -> Course:
    executor = LocalProcesses(ledger.bench.path, 1, 1)
    try:
        return run_jobs(make_jobs(ledger.benchmark), ledger, executor, watch)
    finally:
        executor.close()


def test_workers_stop_with_a_checkpoint_when_the_scheduler_is_killed(tmp_path: Path):
    root = tmp_path / "b"
    matrix = tmp_path / "m.yaml"
    matrix.write_text(json.dumps(small_matrix(steps=4000 * 512).model_dump(mode="json")))
    command = [sys.executable, "-m", "apil_core.cli", "bench", "run", str(matrix), "--out", str(root)]
    scheduler = subprocess.Popen(
        [*command, "--workers", "1"], stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL
    )
    run = BenchDir(root).cell("toy-pursuit/adrl/s0-2048k")
    _until(lambda: run.metrics_path.is_file() and run.metrics_path.read_text().count("\n") >= 2)
    os.kill(scheduler.pid, signal.SIGKILL)
    scheduler.wait()
    _until(lambda: run.summary()["status"] == "interrupted")
    assert run.newest_checkpoint().is_file()
    with run.lock():
        pass  # nobody trains there any more


def _until(condition, seconds: float = 60.0) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "waited too long"
        time.sleep(0.2)
