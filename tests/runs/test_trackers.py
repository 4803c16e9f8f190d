"""Runs recorded with the real wandb and trackio, without a network, and read back from their files."""

from __future__ import annotations

import json
import math
import os
import re
import signal
import sqlite3
import struct
import subprocess
import sys
import time
from collections import Counter
from contextlib import closing, suppress
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import psutil
import pytest
from helpers.small_runs import small_config

from apil_core import ApilError, resume, run
from apil_core.common.extras import install_command
from apil_core.evaluation.progress import Progress
from apil_core.runs.trackers import tracked
from apil_core.training.storage.metrics_log import RowLog
from apil_core.training.storage.recorders import JsonlRecorder, read_metrics
from apil_core.training.storage.run_dir import RunDir

needs_wandb = pytest.mark.skipif(
    find_spec("wandb") is None, reason="wandb is not installed: pip install -e '.[wandb]'"
)
needs_trackio = pytest.mark.skipif(find_spec("trackio") is None, reason="trackio is not installed")

ITERATION = 512
"""Steps of an iteration of ``small_config``."""


@pytest.fixture(autouse=True)
def offline(monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory):
    """Nobody's login, no settings of this machine, no telemetry; and a fresh session of wandb's."""
    for name in os.environ:
        if name.startswith(("WANDB_", "TRACKIO_", "HF_")):
            monkeypatch.delenv(name)
    monkeypatch.setenv("HOME", str(tmp_path_factory.mktemp("home")))
    monkeypatch.setenv("WANDB_MODE", "offline")
    monkeypatch.setenv("WANDB_ERROR_REPORTING", "false")
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    yield
    if sys.modules.get("wandb"):
        with suppress(ConnectionError):  # where its process was killed
            sys.modules["wandb"].teardown()


class Notes(Progress):
    """Keeps notes; ``at`` is called once an iteration is over."""

    def __init__(self, at=lambda iteration: None):
        self.notes: list[str] = []
        self._at = at

    def iteration(self, metrics):
        self._at(metrics["iteration"])

    def note(self, text):
        self.notes.append(text)


def config(*recorders: str, **changes):
    settings = {
        "steps": 4 * ITERATION,
        "evaluation": {"episodes": 8},
        "checkpoint": {"every_iterations": 2, "keep": 9},
    }
    return small_config("adrl", recorders=("jsonl", *recorders), **{**settings, **changes})


def wandb_files(path: Path) -> list[Path]:
    return sorted(path.glob("wandb/offline-run-*/run-*.wandb"), key=lambda file: file.stat().st_mtime_ns)


def wandb_records(path: Path):
    """Records of a ``.wandb`` file: LevelDB's log format (32 KiB blocks, 7-byte headers) after 7 bytes."""
    from wandb.proto.wandb_internal_pb2 import Record

    data, offset, parts = path.read_bytes(), 7, b""
    assert data[:4] == b":W&B"
    while offset + 7 <= len(data):
        if 32768 - offset % 32768 < 7:
            offset += 32768 - offset % 32768
            continue
        _, length, kind = struct.unpack("<IHB", data[offset : offset + 7])
        parts += data[offset + 7 : offset + 7 + length]
        offset += 7 + length
        if kind in (1, 4):  # whole, or the last part
            yield Record.FromString(parts)
            parts = b""


def wandb_runs(path: Path) -> list:
    """Its ``run`` records; wandb's own process may write them a moment after the run has ended."""
    for _ in range(100):
        found = [record.run for record in wandb_records(path) if record.WhichOneof("record_type") == "run"]
        if found:
            return found
        time.sleep(0.1)
    return []


def items(group) -> dict:
    return {item.key or "/".join(item.nested_key): json.loads(item.value_json) for item in group}


def wandb_rows(path: Path) -> list[dict]:
    records = wandb_records(path)
    return [items(r.history.item) for r in records if r.WhichOneof("record_type") == "history"]


def trackio_rows(database: Path) -> list[dict]:
    with closing(sqlite3.connect(database)) as connection:
        rows = connection.execute("SELECT step, metrics FROM metrics ORDER BY id").fetchall()
    return [{"_step": step, **json.loads(metrics)} for step, metrics in rows]


def numbers(rows: list[dict]) -> list[dict]:
    """Rows with NaN as trackers write it."""
    words = {"nan": "NaN", "inf": "Infinity", "-inf": "-Infinity"}
    return [{k: v if math.isfinite(v) else words[str(v)] for k, v in row.items()} for row in rows]


def without_own(row: dict) -> dict:
    return {key: value for key, value in row.items() if not key.startswith("_")}


def whole(path: Path) -> list[dict]:
    return numbers(read_metrics(RunDir(path).metrics_path))


@needs_wandb
def test_wandb_gets_rows_config_and_scores_and_goes_on_without_doubles(tmp_path: Path) -> None:
    path = tmp_path / "s0"
    result = run(config("wandb"), out=path)
    (file,) = wandb_files(path)
    records = list(wandb_records(file))
    (started,) = [r.run for r in records if r.WhichOneof("record_type") == "run"]
    assert (started.project, started.display_name, started.run_group) == ("apil", "s0", "toy-pursuit/adrl")
    assert list(started.tags) == ["toy-pursuit", "adrl"]
    sent = items(started.config.update)
    assert sent["ppo"]["epochs"] == 2
    assert sent["env"] == "toy-pursuit"
    assert json.loads((path / "wandb.json").read_text()) == {"id": started.run_id, "project": "apil"}
    rows = wandb_rows(file)
    assert [row["_step"] for row in rows] == [ITERATION * i for i in (1, 2, 3, 4)]
    assert [without_own(row) for row in rows] == whole(path)
    summary: dict = {}
    for record in records:
        summary |= items(record.summary.update)
    assert summary["final/win"] == result.evaluation.win_rate.value
    assert summary["final/steps"] == 4 * ITERATION
    assert not list(Path(os.environ["HOME"]).rglob("*.wandb"))

    # and from an older checkpoint, all in the newest file, once
    known = json.loads((path / "wandb.json").read_text())
    resume(path, checkpoint_path=RunDir(path).checkpoint_path(2), steps=5 * ITERATION)
    assert json.loads((path / "wandb.json").read_text()) == known
    newest = wandb_files(path)[-1]
    assert len(wandb_files(path)) == 2
    assert newest.name == f"run-{known['id']}.wandb"
    rows = wandb_rows(newest)
    assert [row["_step"] for row in rows] == [ITERATION * i for i in (1, 2, 3, 4, 5)]
    assert [without_own(row) for row in rows] == whole(path)


@needs_wandb
def test_wandbs_own_settings_come_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    elsewhere = tmp_path / "elsewhere"
    for name, value in {
        "PROJECT": "mine",
        "ENTITY": "us",
        "NAME": "x",
        "TAGS": "t",
        "DIR": elsewhere,
    }.items():
        monkeypatch.setenv(f"WANDB_{name}", str(value))
    elsewhere.mkdir()
    run(config("wandb", steps=ITERATION), out=tmp_path / "r")
    (file,) = wandb_files(elsewhere)
    (started,) = wandb_runs(file)
    assert (started.project, started.entity, started.display_name) == ("mine", "us", "x")
    assert list(started.tags) == ["t"]
    assert started.run_group == "toy-pursuit/adrl"


@needs_wandb
def test_wandb_without_login_is_told_before_anything_is_made(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setenv("WANDB_MODE", "online")
    monkeypatch.setenv("WANDB_BASE_URL", "http://127.0.0.1:9")  # nobody there
    with pytest.raises(ApilError, match="recorder wandb: not logged in: run `wandb login`") as caught:
        run(config("wandb"), out=tmp_path / "r")
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "r").exists()


@needs_wandb
def test_a_run_outlives_wandbs_process(tmp_path: Path) -> None:
    def kill(iteration: float) -> None:
        if iteration == 2:
            for child in psutil.Process().children():
                if "wandb-core" in child.name():
                    child.send_signal(signal.SIGKILL)
                    child.wait()

    progress = Notes(kill)
    result = run(config("wandb"), out=tmp_path / "r", progress=progress)
    assert result.status == "finished"
    assert len(whole(tmp_path / "r")) == 4
    (note,) = progress.notes
    assert note.startswith("recorder wandb failed: ")
    assert note.endswith("; the run goes on without it")


@needs_trackio
def test_trackio_gets_rows_config_and_scores_and_goes_on_without_doubles(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setenv("TRACKIO_DIR", str(tmp_path / "shared"))
    path = tmp_path / "s0"
    result = run(config("trackio"), out=path)
    where = json.loads((path / "trackio.json").read_text())
    assert where["project"] == "apil"
    assert where["name"].startswith("s0-")
    database = tmp_path / "shared" / "apil.db"
    *rows, final = trackio_rows(database)
    assert [without_own(row) for row in rows] == whole(path)
    assert [row["_step"] for row in rows] == [row["steps"] for row in rows]
    assert (final["_step"], final["final/win"]) == (4 * ITERATION, result.evaluation.win_rate.value)
    with closing(sqlite3.connect(database)) as connection:
        ((name, stored),) = connection.execute("SELECT run_name, config FROM configs").fetchall()
    stored = json.loads(stored)
    assert (name, stored["_Group"], stored["ppo"]["epochs"]) == (where["name"], "toy-pursuit/adrl", 2)
    assert not any(Path(os.environ["HOME"]).iterdir())

    # and from an older checkpoint, no step twice; others' rows stay
    with closing(sqlite3.connect(database)) as connection, connection:
        columns = "timestamp, run_id, run_name, step, metrics"
        connection.execute(f"INSERT INTO metrics ({columns}) VALUES ('', 'other', 's0', 999999, '{{}}')")
    resume(path, checkpoint_path=RunDir(path).checkpoint_path(2), steps=5 * ITERATION)
    other, *rows, final = sorted(
        trackio_rows(database), key=lambda row: "steps" in row or 2 * ("final/win" in row)
    )
    assert other == {"_step": 999999}
    assert [without_own(row) for row in rows] == whole(path)
    assert [row["_step"] for row in rows] == [ITERATION * i for i in (1, 2, 3, 4, 5)]
    assert final["_step"] == 5 * ITERATION
    with closing(sqlite3.connect(database)) as connection:
        names = connection.execute("SELECT DISTINCT run_name FROM metrics WHERE run_id != 'other'").fetchall()
    assert names == [(where["name"],)]


@needs_trackio
def test_a_server_of_trackios_that_is_not_there_is_told_before_training(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setenv("TRACKIO_SERVER_URL", "http://127.0.0.1:9/?write_token=t")
    with pytest.raises(ApilError, match=r"recorder trackio: .*http://127\.0\.0\.1:9") as caught:
        run(config("trackio"), out=tmp_path / "r")
    assert "\n" not in str(caught.value)
    assert not RunDir(tmp_path / "r").checkpoints()


@needs_trackio
def test_a_run_outlives_trackios_process(tmp_path: Path) -> None:
    def kill(iteration: float) -> None:
        if iteration == 2:
            for child in psutil.Process().children():
                if "apil_core.runs.trackers.trackio_writer" in child.cmdline():
                    child.send_signal(signal.SIGKILL)
                    child.wait()

    progress = Notes(kill)
    assert run(config("trackio"), out=tmp_path / "r", progress=progress).status == "finished"
    assert len(whole(tmp_path / "r")) == 4
    assert progress.notes == ["recorder trackio failed: [Errno 32] Broken pipe; the run goes on without it"]


@pytest.mark.parametrize(("module", "name"), [("wandb", "Weights & Biases"), ("trackio", "Trackio")])
def test_a_missing_library_is_one_line(module: str, name: str, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    message = re.escape(f"records in {name} need {module}: {install_command(module)}")
    with pytest.raises(ApilError, match=message):
        run(config(module), out=tmp_path / "r")
    assert not (tmp_path / "r").exists()


class Failing:
    """Fails at everything."""

    name = "failing"
    dispensable = True

    def __init__(self):
        self.calls: Counter[str] = Counter()

    def __getattr__(self, call: str):
        def fail(*arguments):
            self.calls[call] += 1
            raise ValueError("no\nspace")

        return fail


def test_a_dispensable_recorder_fails_once_and_the_others_go_on(tmp_path: Path) -> None:
    notes: list[str] = []
    failing = Failing()
    log = RowLog([failing, JsonlRecorder(tmp_path)], every=1, note=notes.append)
    log.record({"iteration": 1, "steps": 1}, steps=1)
    log.record({"iteration": 2, "steps": 2}, steps=1)
    log.summarize({"final/win": 1.0})
    log.close()
    assert [row["iteration"] for row in read_metrics(tmp_path / "metrics.jsonl")] == [1, 2]
    assert notes == ["recorder failing failed: no space; the run goes on without it"]
    assert failing.calls == {"record": 1, "close": 1}


def test_a_dispensable_recorder_that_cannot_close_loses_nothing(tmp_path: Path) -> None:
    notes: list[str] = []
    failing = Failing()
    RowLog([failing], every=1, note=notes.append).close()
    assert notes == ["recorder failing failed: no space"]


def test_a_damaged_note_of_where_a_run_is_tracked_begins_anew(tmp_path: Path) -> None:
    run(config(steps=ITERATION, evaluation={"episodes": 0}), out=tmp_path / "r")
    here = tracked.TrackedRun.of(tmp_path / "r")
    here.note_where("wandb", {"id": "x"})
    assert here.where("wandb") == {"id": "x"}
    (tmp_path / "r" / "wandb.json").write_text('{"id"')
    assert here.where("wandb") == {}


@pytest.mark.slow
def test_several_seeds_do_not_share_one_run_of_wandbs(tmp_path: Path, monkeypatch: Any) -> None:
    monkeypatch.setenv("WANDB_RUN_ID", "mine")
    ids = {}
    for name, seeds in (("one", ("--seed", "0")), ("two", ("--seeds", "0..1"))):
        words = ["run", "-m", "adrl", "-e", "toy-pursuit", "--steps", "64", "--num-envs", "8", "--out", name]
        for setting in (
            "ppo.num_steps=16",
            "ppo.minibatches=1",
            "evaluation.episodes=0",
            "recorders=[wandb]",
        ):
            words += ["--set", setting]
        command = [sys.executable, "-m", "apil_core.cli", *words, *seeds, "--quiet"]
        subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)
        ids[name] = [json.loads(f.read_text())["id"] for f in (tmp_path / name).rglob("wandb.json")]
    assert ids["one"] == ["mine"]
    assert len({*ids["two"], "mine"}) == 3
