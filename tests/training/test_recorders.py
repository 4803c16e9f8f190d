"""What is recorded survives kills, NaNs and resumes."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from apil_core.api.specs import load
from apil_core.common.errors import RunDirError
from apil_core.plugins.discovery import discover
from apil_core.training.storage.recorders import (
    JsonlRecorder,
    TensorBoardRecorder,
    read_metrics,
    truncate_metrics,
)
from apil_core.training.storage.run_dir import RunDir


def record(path: Path, *rows: dict[str, float]) -> Path:
    recorder = JsonlRecorder(path)
    for row in rows:
        recorder.record(row)
    recorder.close()
    return path / "metrics.jsonl"


def test_each_line_is_on_disk_before_the_next_iteration(tmp_path: Path) -> None:
    recorder = JsonlRecorder(tmp_path)
    recorder.record({"iteration": 1, "ppo/kl": 0.5})
    assert (tmp_path / "metrics.jsonl").read_text() == '{"iteration": 1, "ppo/kl": 0.5}\n'
    recorder.close()
    recorder.close()


def test_a_second_recorder_appends(tmp_path: Path) -> None:
    record(tmp_path, {"steps": 1})
    assert len(read_metrics(record(tmp_path, {"steps": 2}))) == 2


def test_numbers_json_has_not_become_null(tmp_path: Path) -> None:
    path = record(tmp_path, {"steps": 1, "a": math.nan, "b": math.inf, "c": -math.inf})
    line = path.read_text()
    assert json.loads(line, parse_constant=pytest.fail) == {"steps": 1, "a": None, "b": None, "c": None}
    assert math.isnan(read_metrics(path)[0]["a"])


def test_truncation_drops_later_iterations_and_a_half_line(tmp_path: Path) -> None:
    path = record(tmp_path, *({"iteration": i, "steps": i / 2} for i in range(1, 6)))
    with path.open("a") as file:
        file.write('{"iteration": 6, "steps"')
    assert [row["iteration"] for row in read_metrics(path)] == [1, 2, 3, 4, 5]
    truncate_metrics(path, 3)
    assert path.read_text().splitlines() == [f'{{"iteration": {i}, "steps": {i / 2}}}' for i in (1, 2, 3)]
    truncate_metrics(path, -1)
    assert path.read_text() == ""


def test_truncation_drops_a_complete_looking_line_without_its_newline(tmp_path: Path) -> None:
    path = record(tmp_path, {"iteration": 1})
    with path.open("a") as file:
        file.write('{"iteration": 1}')
    truncate_metrics(path, 1)
    assert path.read_text() == '{"iteration": 1}\n'


def test_truncating_nothing_is_fine(tmp_path: Path) -> None:
    truncate_metrics(tmp_path / "metrics.jsonl", 3)
    assert not (tmp_path / "metrics.jsonl").exists()


@pytest.mark.parametrize("line", ['{"iter', '{"stexs": 2}', '{"steps": null}', '{"steps": "x"}', "[2]"])
def test_damage_in_the_middle_is_reported(tmp_path: Path, line: str) -> None:
    path = tmp_path / "metrics.jsonl"
    path.write_text(f'{{"steps": 1}}\n{line}\n{{"steps": 3}}\n')
    with pytest.raises(RunDirError, match=f"{path}:2: damaged line"):
        read_metrics(path)


def test_an_unwritable_place_is_named(tmp_path: Path) -> None:
    with pytest.raises(RunDirError, match=r"cannot write .*: No such file or directory"):
        JsonlRecorder(tmp_path / "missing")


def test_tensorboard_reads_back_what_was_recorded(tmp_path: Path) -> None:
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    recorder = TensorBoardRecorder(tmp_path)
    recorder.record({"steps": 128, "ppo/kl": 0.25})
    recorder.record({"steps": 256, "ppo/kl": 0.5})
    recorder.close()
    recorder.close()
    events = EventAccumulator(str(tmp_path / "tensorboard"))
    events.Reload()
    assert [(e.step, e.value) for e in events.Scalars("ppo/kl")] == [(128, 0.25), (256, 0.5)]


def test_both_come_in_through_the_plugin_door() -> None:
    recorders = discover().recorders
    assert load(recorders["jsonl"].factory) is JsonlRecorder
    assert load(recorders["tensorboard"].factory) is TensorBoardRecorder


def test_the_newest_row_is_found_in_a_damaged_file(tmp_path: Path):
    run_dir = RunDir(tmp_path)
    run_dir.metrics_path.write_bytes(b'{"steps": 1}\n{"steps": 2}\n\xff\n[3]\n{"steps": 4')
    assert run_dir.last_metrics() == {"steps": 2}
