"""Real benchmarks on the toy game: what is run, kept, resumed, reported."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import threading
from contextlib import closing
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from apil_core.cli import main
from apil_core.common.extras import install_command
from apil_core.studies.bench.cells import resolve_matrix
from apil_core.studies.bench.executor import LocalProcesses
from apil_core.studies.bench.folder import BenchDir, read_score, score_path
from apil_core.studies.bench.jobs import JobStatus, make_jobs
from apil_core.studies.bench.schedule import Watch, run_jobs
from apil_core.studies.bench.work import perform
from apil_core.training.storage.recorders import read_metrics
from bench.small_matrix import Here, made, outcome, process_of, rows_of, small_matrix, undisturbed, until

CELL = "cells/toy-pursuit/adrl/s0"
LONG = small_matrix(methods=["adrl", "apl"], steps=32 * 512)
FIRST, SECOND = "cells/toy-pursuit/adrl/s0", "cells/toy-pursuit/apl/s0"


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A benchmark of one cell, done."""
    status = undisturbed(tmp_path_factory.mktemp("finished") / "b", small_matrix())
    return status.bench.path


@pytest.fixture
def done(finished: Path, tmp_path: Path) -> JobStatus:
    """A copy of it to do things to."""
    shutil.copytree(finished, tmp_path / "b")
    return JobStatus(BenchDir(tmp_path / "b"), resolve_matrix(small_matrix()))


@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch) -> None:
    """``apil bench run`` does its jobs in this process: what they do is the same, and quicker begun."""
    monkeypatch.setattr("apil_core.cli.bench_run.Placement.start", lambda where, root: Here(root))


def call(*words: Any) -> int:
    """``apil bench run``; returns the exit code."""
    with pytest.raises(SystemExit) as caught:
        main(["bench", "run", *map(str, words)])
    return int(str(caught.value.code))


def written(path: Path, matrix: Any) -> Path:
    path.write_text(json.dumps(matrix.model_dump(mode="json")))
    return path


def test_a_job_does_what_is_missing_and_no_more(done: JobStatus):
    job = make_jobs(done.benchmark)[0]
    assert job.name == CELL
    assert done.is_done(job)
    run = done.bench.cell(job.subject)
    before = {path: path.stat().st_mtime_ns for path in run.path.rglob("*.json*")}
    assert perform(done.bench.path, CELL) == "done"
    assert {path: path.stat().st_mtime_ns for path in run.path.rglob("*.json*")} == before

    score = read_score(run.path, "plain")
    assert (score.episodes, score.trained_steps, score.blind) == (20, 3072, None)
    # more games are asked for now: played anew, the training is kept
    more = made(done.bench.path, small_matrix(scores={"plain": {"episodes": 30}}))
    assert not more.is_done(job)
    perform(done.bench.path, CELL)
    assert read_score(run.path, "plain").episodes == 30
    assert [row["steps"] for row in read_metrics(run.metrics_path)] == [512 * i for i in range(1, 7)]

    # a damaged score is an error, not played over
    score_path(run.path, "plain").write_text("{")
    assert not more.is_done(job)
    with pytest.raises(Exception, match=r"plain\.json is damaged"):
        perform(done.bench.path, CELL)
    assert score_path(run.path, "plain").read_text() == "{"


def test_a_job_waits_for_a_process_that_is_still_at_it(done: JobStatus, monkeypatch: pytest.MonkeyPatch):
    """One whose supervisor died, and that is writing its last checkpoint."""
    from apil_core.common.errors import RunDirError
    from apil_core.studies.bench import work

    monkeypatch.setattr(work, "_PATIENCE", 0.2)
    with work._alone(done.bench, CELL), pytest.raises(RunDirError, match=f"has been at {CELL}"):
        perform(done.bench.path, CELL)
    assert "another process has been at" in done.bench.failure(CELL)

    monkeypatch.setattr(work, "_PATIENCE", 60.0)
    with work._alone(done.bench, CELL):
        successor = threading.Thread(target=perform, args=(done.bench.path, CELL))
        successor.start()
        successor.join(0.5)
        assert successor.is_alive()
    successor.join(60)
    assert done.bench.failure(CELL) == ""


def test_other_settings_are_refused(done: JobStatus, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    changed = small_matrix(config={**small_matrix().config, "num_envs": 16})
    path = written(tmp_path / "changed.yaml", changed)
    assert call(path, "--out", done.bench.path, "--quiet") == 2
    assert "was begun with num_envs 32, the matrix says 16" in capsys.readouterr().err


def test_a_failing_cell_does_not_stop_the_others(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], here: None
):
    """A plugin that raises in its third iteration, beside a sound method; then the plugin is mended."""
    plugin = tmp_path / "shaky.py"
    plugin.write_text("""
from pathlib import Path
from apil_core import Method, MethodSpec, hookimpl

class Shaky(Method):
    @hookimpl
    def update_auxiliary(self, run, rollout):
        if run.iteration == 2 and not Path(__file__).with_name("mended").exists():
            raise RuntimeError("the third iteration is too much")

@hookimpl
def register_methods():
    return [MethodSpec(name="shaky", factory="shaky:Shaky")]
""")
    config = {**small_matrix().config, "plugins": [str(plugin)]}
    path = written(tmp_path / "m.yaml", small_matrix(methods=["shaky", "adrl"], config=config))
    words = (path, "--out", tmp_path / "b", "--quiet", "--json", "--trust")
    assert call(*words) == 1
    told = json.loads(capsys.readouterr().out)
    assert told["jobs"] == {"cells/toy-pursuit/shaky/s0": "failed", CELL: "done"}
    assert "the third iteration is too much" in told["failures"]["cells/toy-pursuit/shaky/s0"]

    (tmp_path / "mended").touch()
    assert call(*words) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["kept"], told["failures"]) == ([CELL], {})
    # the shaky cell went on from its checkpoint after two iterations
    sessions = json.loads((tmp_path / "b/cells/toy-pursuit/shaky/s0/environment.json").read_text())
    assert len(sessions) == 2


def test_a_process_that_ends_without_its_result_has_failed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    """Whatever its exit code, and in a process of its own; beside one that is done."""
    plugin = tmp_path / "leaver.py"
    plugin.write_text("""
import os
from apil_core import Method, MethodSpec, hookimpl

class Leaver(Method):
    @hookimpl
    def update_auxiliary(self, run, rollout):
        os._exit(0)

@hookimpl
def register_methods():
    return [MethodSpec(name="leaver", factory="leaver:Leaver")]
""")
    config = {**small_matrix().config, "plugins": [str(plugin)]}
    path = written(tmp_path / "m.yaml", small_matrix(methods=["leaver", "adrl"], config=config))
    assert call(path, "--out", tmp_path / "b", "--quiet", "--json", "--trust") == 1
    told = json.loads(capsys.readouterr().out)
    assert told["jobs"] == {"cells/toy-pursuit/leaver/s0": "failed", CELL: "done"}
    assert told["failures"] == {"cells/toy-pursuit/leaver/s0": "its process ended without its result"}


@pytest.mark.slow
def test_killed_and_stopped_anywhere_it_ends_like_one_that_was_not(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], request: pytest.FixtureRequest
):
    """One job's process is killed, the next is going when the scheduler gets SIGTERM; then it goes on."""
    root = tmp_path / "broken"
    path = written(tmp_path / "m.yaml", LONG)
    status = JobStatus(BenchDir(root), resolve_matrix(LONG))

    def disturb() -> None:
        until(lambda: rows_of(status, FIRST) >= 2)
        process_of(status, FIRST).kill()
        until(lambda: rows_of(status, SECOND) >= 2)
        os.kill(os.getpid(), signal.SIGTERM)

    thread = threading.Thread(target=disturb)
    thread.start()
    assert call(path, "--out", root, "--workers", 1, "--json") == 130
    thread.join()
    captured = capsys.readouterr()
    told = json.loads(captured.out)
    assert told["interrupted"]
    assert told["jobs"] == {FIRST: "failed", SECOND: "interrupted"}
    assert told["failures"] == {FIRST: "its process was ended by SIGKILL, perhaps for want of memory"}
    assert "stopping: what runs finishes its iteration" in captured.err
    assert f"go on with: apil bench run {root}" in captured.err
    stopped = status.bench.cell(SECOND.partition("/")[2])
    assert stopped.summary()["status"] == "interrupted"
    # its checkpoint is that of its last row: nothing of what it had learnt is learnt again
    assert stopped.newest_checkpoint() == stopped.checkpoint_path(rows_of(status, SECOND))

    request.getfixturevalue("here")
    assert call(root, "--json") == 0  # the directory is enough
    assert json.loads(capsys.readouterr().out)["jobs"] == {FIRST: "done", SECOND: "done"}
    assert outcome(status) == outcome(undisturbed(tmp_path / "whole", LONG))
    assert call(root, "--json") == 0
    assert json.loads(capsys.readouterr().out)["kept"] == [FIRST, SECOND]


def test_stopped_while_the_first_job_begins_and_others_queue(tmp_path: Path):
    status = made(tmp_path / "b", small_matrix(methods=["adrl", "apl", "apil"]))

    class Press(Watch):
        pressed = False

        def update(self, states: dict[str, Any]) -> None:
            if "running" in states.values() and not self.pressed:
                self.pressed = True
                os.kill(os.getpid(), signal.SIGINT)

    jobs = make_jobs(status.benchmark)
    with closing(LocalProcesses(status.bench.path, 1, 1)) as executor:
        course = run_jobs(jobs, status, executor, Press())
    assert course.interrupted
    assert list(course.states.values()) == ["interrupted", "waiting", "waiting"]
    assert [status.bench.failure(job.name) for job in jobs] == ["", "", ""]


def test_a_second_ctrl_c_ends_jobs_at_once(tmp_path: Path):
    """A job in a process that does not listen: only a kill ends it."""
    from apil_core.studies.bench.supervised import SupervisedJob

    status = made(tmp_path / "b", small_matrix())
    with SupervisedJob(status.bench.path, CELL, 1) as job:
        os.kill(job._process.pid, signal.SIGSTOP)
        job.stop()
        assert job._process.poll() is None
        job.stop()
        assert job.wait() == "interrupted"
    assert status.bench.failure(CELL) == ""


@pytest.mark.slow
def test_a_job_stops_with_a_checkpoint_when_its_supervisor_is_killed(tmp_path: Path):
    """And hears it although Ctrl-C is blocked where it was started, as it is in Ray's workers."""
    steps = 4000 * 512
    status = made(tmp_path / "b", small_matrix(steps=steps))
    name = make_jobs(status.benchmark)[0].name
    code = (
        "import signal, sys; from pathlib import Path\n"
        "from apil_core.studies.bench.executor import LocalProcesses\n"
        "signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})\n"
        "LocalProcesses(Path(sys.argv[1]), 1, 1).submit(sys.argv[2]).result()"
    )
    supervisor = subprocess.Popen([sys.executable, "-c", code, str(status.bench.path), name])
    until(lambda: rows_of(status, name) >= 2)
    process = process_of(status, name)
    supervisor.kill()
    supervisor.wait()
    until(lambda: not process.is_running())
    run = status.bench.cell(name.partition("/")[2])
    assert run.summary()["status"] == "interrupted"
    assert run.newest_checkpoint().is_file()


@pytest.mark.slow
def test_a_dry_run_of_a_half_done_benchmark(
    done: JobStatus, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    path = written(tmp_path / "m.yaml", small_matrix(methods=["adrl", "apl"], snapshots={"pictures": 2}))
    before = sorted(done.bench.path.rglob("*"))
    words = (path, "--out", done.bench.path, "--dry-run", "--workers", 2, "--quiet")
    assert call(*words, "--json") == 0
    plan = json.loads(capsys.readouterr().out)
    states = {cell["name"]: (cell["state"], cell["rate_from"]) for cell in plan["cells"]}
    assert states == {
        "toy-pursuit/adrl/s0": ("done", "its run"),
        "toy-pursuit/apl/s0": ("new", "measured now"),
    }
    ready, new = plan["cells"]
    assert (ready["training_seconds"], ready["scoring_seconds"]) == (0, 0)
    assert new["training_seconds"] == pytest.approx(3072 / new["steps_per_second"])
    assert plan["other_jobs"] == {"snapshots": 2}
    left = new["training_seconds"] + new["scoring_seconds"]
    assert plan["hours"] == pytest.approx(left / 2 / 3600)

    assert call(*words) == 0
    lines = capsys.readouterr().out.splitlines()
    assert any(line.split()[:2] == ["toy-pursuit/apl/s0", "new"] for line in lines)
    assert "2 cells, 6,144 steps; besides: 2 × snapshots" in lines
    assert sorted(done.bench.path.rglob("*")) == before, "a dry run wrote something"

    monkeypatch.setitem(sys.modules, "ray", None)  # not installed
    assert call(path, "--out", done.bench.path, "--dry-run", "--executor", "ray") == 2
    assert capsys.readouterr().err == f"apil: Ray clusters need ray: {install_command('ray')}\n"
    monkeypatch.setitem(sys.modules, "ray", ModuleType("ray"))  # how many workers is not known yet
    assert call(*words[:-3], "--executor", "ray", "--quiet") == 0
    assert "h on 1 worker if" in capsys.readouterr().out


def test_the_live_table_shows_what_runs(done: JobStatus, monkeypatch: pytest.MonkeyPatch):
    from rich.console import Console

    from apil_core.cli import bench_table

    screen = Console(record=True, width=120, file=open(os.devnull, "w"), force_terminal=True)  # noqa: SIM115
    monkeypatch.setattr(bench_table, "console", lambda **options: screen)
    job = make_jobs(done.benchmark)[0]
    longer = type(job)(job.kind, job.subject, steps=2 * job.steps)
    watch = bench_table.TableWatch([longer], done)
    watch.update({CELL: "running", "cells/another": "waiting", "cells/third": "waiting"})
    screen.print(watch._live.get_renderable())
    watch.ended(longer, "failed", "no [bold]luck[/bold]")
    watch.stopping(at_once=False)
    watch.close()
    shown = screen.export_text()
    row = next(line for line in shown.splitlines() if line.strip().startswith(CELL))
    assert "0.00 M of 0.01 M" in row
    assert row.count("%") == 2  # win and tie, as logged
    assert "1 running, 2 waiting" in shown
    assert f"{CELL} failed: no [bold]luck[/bold]" in shown
    assert "once more: at once" in shown


def test_mistakes_are_one_line(done: JobStatus, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    def told(code: int, *words: Any) -> str:
        assert call(*words, "--quiet") == code
        (line,) = capsys.readouterr().err.splitlines()
        return line

    other = tmp_path / "other"
    other.mkdir()
    (other / "letter.txt").write_text("no benchmark")
    path = written(tmp_path / "m.yaml", small_matrix())
    assert f"{other} exists and is no benchmark" in told(2, path, "--out", other)
    assert f"{other} is no benchmark (no matrix.yaml in it)" in told(2, other)
    assert "leave --out out" in told(2, done.bench.path, "--out", other)
    with done.bench.lock():
        assert f"another process is running the benchmark in {done.bench.path}" in told(2, done.bench.path)
    assert "--address is a Ray cluster's" in told(2, path, "--out", tmp_path / "c", "--address", "auto")
    assert "--workers must be at least 1" in told(2, path, "--out", tmp_path / "c", "--workers", 0)
