"""Runs of very many iterations keep a bounded log, and it is the same log however often they stop."""

from __future__ import annotations

import math
import os
import signal
from pathlib import Path

import pytest
from helpers.small_runs import small_config

from apil_core import RunConfig, RunDirError, resume, run
from apil_core.evaluation.progress import Progress
from apil_core.studies.curves.curves import final_scores, read_curve
from apil_core.training.storage.metrics_log import RowLog, iterations_per_row, merged
from apil_core.training.storage.recorders import read_metrics
from apil_core.training.storage.run_dir import RunDir

ITERATION = 512
"""Steps of an iteration of ``small_config``."""

TIMED = {"wall_seconds", "steps_per_second", "collect_seconds", "update_seconds", "memory_mb"}
"""Metrics that no two runs share."""


@pytest.mark.parametrize(
    ("steps", "num_envs", "num_steps", "rows", "k"),
    [
        (35_000_000, 128, 128, 10_000, 1),  # the default batch: 2137 iterations
        (163_840_000, 128, 128, 10_000, 1),  # 10 000 exactly
        (163_840_001, 128, 128, 10_000, 2),
        (35_000_000, 8, 16, 10_000, 28),  # 273 438 iterations: 27 to a row would be 10 128 rows
        (1, 128, 128, 10_000, 1),
        (35_000_000, 128, 128, 1, 2137),
    ],
)
def test_the_least_k_that_keeps_to_the_rows(steps, num_envs, num_steps, rows, k):
    config = RunConfig(steps=steps, num_envs=num_envs, ppo={"num_steps": num_steps}, log_rows=rows)
    assert iterations_per_row(config) == k


def metrics(iteration: int, **others: float) -> dict[str, float]:
    return {"iteration": iteration, "steps": 100 * iteration, "row_steps": 100, **others}


def test_games_and_endings_are_summed():
    row = merged([metrics(1, games=2, **{"cause/out": 2}), metrics(2, games=3, **{"cause/out": 0})])
    assert row["games"] == 5
    assert row["cause/out"] == 2
    assert isinstance(row["games"], int)
    assert (row["row_iterations"], row["row_steps"]) == (2, 200)


def test_totals_and_states_are_the_last():
    names = (
        "wall_seconds",
        "total_steps",
        "games_total",
        "window_wins",
        "opponent/adrl/wins",
        "memory_mb",
        "evaluation/win",
        "x/y_total",
    )
    row = merged([metrics(3, **dict.fromkeys(names, 1.0)), metrics(4, **dict.fromkeys(names, 7.0))])
    assert {name: row[name] for name in names} == dict.fromkeys(names, 7.0)
    assert (row["iteration"], row["steps"]) == (4, 400)


def test_a_score_of_an_earlier_iteration_is_not_lost():
    assert merged([metrics(1, **{"evaluation/win": 0.25}), metrics(2)])["evaluation/win"] == 0.25


def test_means_are_weighted_by_steps():
    first, second = metrics(1, **{"ppo/kl": 1.0}), metrics(2, **{"ppo/kl": 4.0})
    second["row_steps"] = 200  # side games
    assert merged([first, second])["ppo/kl"] == 3.0  # (1·100 + 4·200) / 300


def test_means_over_games_are_weighted_by_games():
    rows = [metrics(1, games=1, **{"return/adversary": 10.0}), metrics(2, games=0)]
    rows.append(metrics(3, games=3, **{"return/adversary": 2.0}))
    assert merged(rows)["return/adversary"] == 4.0  # (10·1 + 2·3) / 4


def test_steps_per_second_are_steps_by_seconds():
    fast = metrics(1, steps_per_second=100.0, collect_seconds=0.75, update_seconds=0.25)
    slow = metrics(2, steps_per_second=25.0, collect_seconds=3.0, update_seconds=1.0)
    row = merged([fast, slow])
    assert row["steps_per_second"] == 40.0  # 200 steps in 5 s
    assert row["update_seconds"] == 0.625  # of one iteration


def test_a_number_that_is_none_spoils_no_mean():
    rows = [metrics(1, a=math.nan, b=math.nan), metrics(2, a=3.0, b=math.inf)]
    assert merged(rows)["a"] == 3.0
    assert math.isnan(merged(rows)["b"])


def test_a_single_iteration_is_itself():
    assert merged([metrics(1, a=0.1)]) == {"iteration": 1, "steps": 100, "a": 0.1}


class Kept:
    """Keeps rows; from ``fails_at`` on it raises."""

    def __init__(self, fails_at: int = 99):
        self.rows: list[dict[str, float]] = []
        self.closed = False
        self._fails_at = fails_at

    def record(self, row):
        if row["iteration"] >= self._fails_at:
            raise RunDirError("disk full")
        self.rows.append(row)

    def close(self):
        self.closed = True


def test_rows_end_with_every_kth_iteration_and_with_scores():
    kept = Kept()
    log = RowLog([kept], every=4)
    for i in range(1, 11):
        log.record({"iteration": i, **({"evaluation/win": 1.0} if i == 6 else {})}, steps=1)
    assert [row["iteration"] for row in kept.rows] == [4, 6, 8]
    assert [row["row_iterations"] for row in kept.rows] == [4, 2, 2]
    assert [row["iteration"] for row in log.pending] == [9, 10]
    log.close()
    assert [row["iteration"] for row in kept.rows] == [4, 6, 8, 10]
    assert kept.closed


def test_no_recorder_gets_a_row_twice_when_another_fails():
    kept, full = Kept(), Kept(fails_at=2)
    log = RowLog([kept, full], every=2)
    log.record({"iteration": 1}, steps=1)
    with pytest.raises(RunDirError):
        log.record({"iteration": 2}, steps=1)
    assert len(log.pending) == 2  # so that a checkpoint knows of them
    log.close()
    assert [len(recorder.rows) for recorder in (kept, full)] == [1, 0]
    assert kept.closed
    assert full.closed


def rows_of(path: Path) -> list[dict[str, float]]:
    rows = read_metrics(RunDir(path).metrics_path)
    return [{name: value for name, value in row.items() if name not in TIMED} for row in rows]


def sparse_config(**changes):
    """Ten iterations, four to a row, checkpoints after every third."""
    settings = {"steps": 10 * ITERATION, "log_rows": 3, "checkpoint": {"every_iterations": 3, "keep": 9}}
    return small_config("adrl", **{**settings, **changes})


def test_merged_rows_of_a_run_sum_up_single_ones(tmp_path):
    run(sparse_config(), out=tmp_path / "merged")
    run(sparse_config(log_rows=10), out=tmp_path / "single")
    few, many = rows_of(tmp_path / "merged"), rows_of(tmp_path / "single")
    assert [row["iteration"] for row in few] == [4, 8, 10]
    assert [row["iteration"] for row in many] == list(range(1, 11))
    assert few[0]["games"] == sum(row["games"] for row in many[:4])
    assert few[1]["ppo/kl"] == pytest.approx(sum(row["ppo/kl"] for row in many[4:8]) / 4)
    assert few[2]["window_wins"] == many[9]["window_wins"]
    assert sum(row["row_steps"] for row in few) == 10 * ITERATION
    assert not any("row_steps" in row or "row_iterations" in row for row in many)
    ends = [read_curve(RunDir(tmp_path / name)).lines["return"].value[-1] for name in ("merged", "single")]
    assert ends[0] == pytest.approx(ends[1])


class StopAfter(Progress):
    """As a kill would: no more checkpoint."""

    def __init__(self, iteration: int):
        self.last = iteration

    def iteration(self, metrics):
        if metrics["iteration"] == self.last:
            raise KeyboardInterrupt


@pytest.mark.parametrize("last", [5, pytest.param(9, marks=pytest.mark.slow)])
def test_a_killed_run_goes_on_with_the_same_rows(tmp_path, last):
    run(sparse_config(), out=tmp_path / "whole")
    with pytest.raises(KeyboardInterrupt):
        run(sparse_config(), out=tmp_path / "killed", progress=StopAfter(last + 1))
    resume(tmp_path / "killed")
    assert rows_of(tmp_path / "killed") == rows_of(tmp_path / "whole")


class CtrlC(Progress):
    """Within a row."""

    def iteration(self, metrics):
        if metrics["iteration"] == 6:
            os.kill(os.getpid(), signal.SIGINT)


def test_an_interrupted_run_shows_all_it_did_and_goes_on_with_the_same_rows(tmp_path):
    run(sparse_config(), out=tmp_path / "whole")
    assert run(sparse_config(), out=tmp_path / "stopped", progress=CtrlC()).status == "interrupted"
    rows = rows_of(tmp_path / "stopped")
    assert [(row["iteration"], row["row_iterations"]) for row in rows] == [(4, 4), (6, 2)]
    resume(tmp_path / "stopped")
    assert rows_of(tmp_path / "stopped") == rows_of(tmp_path / "whole")


def test_an_older_checkpoint_within_a_row_loses_and_doubles_nothing(tmp_path):
    run(sparse_config(), out=tmp_path / "r")
    whole = rows_of(tmp_path / "r")
    resume(tmp_path / "r", checkpoint_path=RunDir(tmp_path / "r").checkpoint_path(6))
    assert rows_of(tmp_path / "r") == whole


def test_an_extended_run_completes_its_last_row_and_keeps_its_scores(tmp_path):
    config = sparse_config(evaluation={"episodes": 8})
    run(config, out=tmp_path / "r")
    resume(tmp_path / "r", steps=12 * ITERATION)  # still four to a row
    rows = rows_of(tmp_path / "r")
    assert [row["iteration"] for row in rows] == [4, 8, 12]
    assert rows[2]["row_iterations"] == 4
    scores = final_scores(RunDir(tmp_path / "r"))
    assert [score.trained_steps for score in scores] == [10 * ITERATION, 12 * ITERATION]


def test_scores_during_training_stand_at_their_own_steps(tmp_path):
    periodic = {"episodes": 0, "every_steps": 3 * ITERATION, "periodic_episodes": 4}
    run(sparse_config(evaluation=periodic), out=tmp_path / "r")
    rows = rows_of(tmp_path / "r")
    assert [row["iteration"] for row in rows] == [3, 4, 6, 8, 9, 10]
    assert [row["steps"] // ITERATION for row in rows if "evaluation/win" in row] == [3, 6, 9]


def test_tensorboard_shows_each_row_once_after_an_extension(tmp_path):
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    run(sparse_config(recorders=("jsonl", "tensorboard")), out=tmp_path / "r")
    resume(tmp_path / "r", steps=12 * ITERATION)
    events = EventAccumulator(str(tmp_path / "r" / "tensorboard"))
    events.Reload()
    steps = [event.step for event in events.Scalars("ppo/kl")]
    assert steps == [4 * ITERATION, 8 * ITERATION, 12 * ITERATION]


def test_memory_is_in_every_row(tmp_path):
    import psutil

    run(small_config("adrl"), out=tmp_path / "r")
    rows = read_metrics(RunDir(tmp_path / "r").metrics_path)
    assert all(0 < row["memory_mb"] < psutil.virtual_memory().total / 1e6 for row in rows)
    names = list(rows[-1])
    assert names[-1] == "memory_mb"
