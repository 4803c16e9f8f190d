"""Evaluations during training: the best checkpoint is kept, and training may end before its budget."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from helpers.small_runs import metrics_of, small_config
from pydantic import ValidationError

from apil_core import RunConfig, RunDirError, evaluate, resume, run
from apil_core.api.config import EvaluationConfig, StopConfig
from apil_core.evaluation.progress import Progress
from apil_core.evaluation.results import EvaluationResult, wilson
from apil_core.runs.best import EvaluationHistory
from apil_core.training.storage import checkpoint
from apil_core.training.storage.run_dir import RunDir

ITERATION = 32 * 16


def scored(**changes: Any) -> RunConfig:
    """Six iterations, an evaluation of 20 games after every second one, one checkpoint kept."""
    evaluation = {"episodes": 10, "every_steps": 2 * ITERATION, "periodic_episodes": 20, **changes}
    ppo = {"num_steps": 16, "epochs": 2, "minibatches": 2}
    keep = {"every_iterations": 1, "keep": 1}
    return small_config(
        "adrl", num_envs=32, steps=6 * ITERATION, ppo=ppo, evaluation=evaluation, checkpoint=keep
    )


def won(*wins: int) -> EvaluationHistory:
    history = EvaluationHistory()
    for i, count in enumerate(wins):
        result: Any = SimpleNamespace(episodes=100, wins=count, win_rate=wilson(count, 100))
        history.add(result, i + 1)
    return history


def test_the_best_is_the_first_of_equals():
    assert EvaluationHistory().best is None
    assert won(10, 30, 30, 20).best == {"steps": 2, "games": 100, "wins": 30, "low": wilson(30, 100).low}


def test_what_ends_a_training_early():
    above = StopConfig(win_rate_above=0.5)
    assert won(59).why_stop(above) == ""  # its interval begins at 49.2 %
    assert wilson(59, 100).low < 0.5 < wilson(61, 100).low
    assert won(61).why_stop(above) == "win rate 61.0% lies above 50.0%, its interval too"
    assert won(61, 20).why_stop(above) == ""  # the last one counts
    patient = StopConfig(no_gain_in=2)
    assert won(30, 20).why_stop(patient) == ""
    assert won(30, 20, 31, 20).why_stop(patient) == ""
    assert won(30, 20, 30).why_stop(patient) == "no gain in 2 evaluations over 30.0% at 1 steps"
    assert won(30, 20, 30).why_stop(StopConfig()) == ""


def test_stopping_needs_evaluations():
    with pytest.raises(ValidationError, match="stop_when needs evaluations during training: set every_steps"):
        EvaluationConfig(stop_when=StopConfig(no_gain_in=2))


class Heard(Progress):
    """Evaluations and notes of a run."""

    def __init__(self) -> None:
        self.results: list[EvaluationResult] = []
        self.notes: list[str] = []

    def evaluation(self, result: EvaluationResult, steps: int) -> None:
        self.results.append(result)

    def note(self, text: str) -> None:
        self.notes.append(text)


def test_the_best_checkpoint_is_kept_and_its_history_goes_on(tmp_path):
    heard = Heard()
    run(scored(), out=tmp_path / "whole", progress=heard)
    whole = RunDir(tmp_path / "whole")
    assert len(whole.checkpoints()) == 1
    history = checkpoint.read(whole.newest_checkpoint())["evaluations"]
    assert [row["steps"] for row in history] == [2 * ITERATION, 4 * ITERATION, 6 * ITERATION]
    *periodic, final = heard.results
    assert [row["wins"] for row in history] == [result.wins for result in periodic]
    best = max(history, key=lambda row: row["wins"])
    assert checkpoint.read(whole.best_path)["steps"] == best["steps"]
    assert json.loads(whole.result_path.read_text())["best"] == best
    # the same weights in the same games win as often, and the final score is of others
    again = evaluate(whole.path, checkpoint_path="best", episodes=20, seed=periodic[0].seed)
    assert (again.wins, again.trained_steps) == (best["wins"], best["steps"])
    assert {result.seed for result in periodic} != {final.seed}

    run(scored().model_copy(update={"steps": 3 * ITERATION}), out=tmp_path / "halves")
    resume(tmp_path / "halves", steps=6 * ITERATION)
    halves = RunDir(tmp_path / "halves")
    assert checkpoint.read(halves.newest_checkpoint())["evaluations"] == history
    assert checkpoint.read(halves.best_path)["steps"] == best["steps"]


def test_going_back_behind_the_best_forgets_it(tmp_path):
    config = scored()
    config.checkpoint.keep = 9
    run(config, out=tmp_path / "r")
    directory = RunDir(tmp_path / "r")
    resume(directory.path, checkpoint_path=directory.checkpoint_path(1), steps=7 * ITERATION)
    assert directory.best_path.with_name("best.pt.abandoned").is_file()
    history = checkpoint.read(directory.newest_checkpoint())["evaluations"]
    assert [row["steps"] for row in history] == [2 * ITERATION, 4 * ITERATION, 6 * ITERATION]
    assert directory.best_path.is_file()


@pytest.mark.parametrize("where", ["best", "r/checkpoints/../checkpoints/best.pt", "copy.pt"])
def test_going_on_from_the_best_leaves_a_checkpoint_at_once(tmp_path, monkeypatch, where):
    config = scored()
    run(config, out=tmp_path / "r")
    directory = RunDir(tmp_path / "r")
    best = checkpoint.read(directory.best_path)
    shutil.copy(directory.best_path, tmp_path / "copy.pt")
    monkeypatch.chdir(tmp_path)

    def killed(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("apil_core.runs.session.Session.run", killed)
    with pytest.raises(KeyboardInterrupt):
        resume(directory.path, checkpoint_path=Path(where), steps=9 * ITERATION)
    assert directory.newest_checkpoint() == directory.checkpoint_path(best["iteration"])
    assert directory.best_path.is_file()


def test_without_evaluations_there_is_no_best(tmp_path):
    run(scored(every_steps=0), out=tmp_path / "r")
    for use in (resume, evaluate):
        with pytest.raises(RunDirError, match=r"has no best checkpoint: .*--set evaluation.every_steps=N"):
            use(tmp_path / "r", checkpoint_path=Path("best"))


def test_a_condition_ends_the_training_and_its_score_follows(tmp_path):
    heard = Heard()
    config = scored(stop_when={"win_rate_above": 0.0})
    result = run(config, out=tmp_path / "r", progress=heard)
    assert (result.status, result.steps) == ("finished", 2 * ITERATION)
    assert result.evaluation is not None
    assert result.evaluation.trained_steps == 2 * ITERATION
    assert result.stopped.endswith("lies above 0.0%, its interval too")
    assert f"stopped early: {result.stopped}" in heard.notes
    # whoever resumes it wants more; the condition is looked at again with the next evaluation
    assert resume(tmp_path / "r").steps == 4 * ITERATION


@pytest.mark.parametrize("steps", [None, 6 * ITERATION])  # a benchmark always says how many
def test_a_run_killed_in_its_last_score_stays_stopped(tmp_path, steps):
    config = scored(stop_when={"win_rate_above": 0.0})
    run(config, out=tmp_path / "r")
    (tmp_path / "r" / "result.json").unlink()
    result = resume(tmp_path / "r", steps=steps)
    assert (result.status, result.steps) == ("finished", 2 * ITERATION)
    assert result.stopped


def test_a_plugin_can_end_the_training(tmp_path):
    (tmp_path / "enough.py").write_text(
        "from apil_core import hookimpl\n\n\n@hookimpl\ndef iteration_finished(run, metrics):\n"
        "    if run.iteration == 3:\n        run.stop('three are enough')\n"
    )
    config = scored(every_steps=0)
    config = config.model_copy(update={"plugins": (str(tmp_path / "enough.py"),), "observers": ("enough",)})
    result = run(config, out=tmp_path / "r")
    assert (result.status, result.steps, result.stopped) == ("finished", 3 * ITERATION, "three are enough")
    assert result.evaluation is not None


def test_an_evaluation_that_fails_is_made_up_for(tmp_path):
    run(scored(), out=tmp_path / "whole")

    class OutOfMemory(Progress):
        def evaluation_progress(self, done: int, total: int) -> None:
            raise MemoryError

    with pytest.raises(MemoryError):
        run(scored(), out=tmp_path / "r", progress=OutOfMemory())
    assert checkpoint.read(RunDir(tmp_path / "r").newest_checkpoint())["iteration"] == 1
    resume(tmp_path / "r")
    ends = [checkpoint.read(RunDir(tmp_path / name).newest_checkpoint()) for name in ("whole", "r")]
    assert ends[0]["evaluations"] == ends[1]["evaluations"]
    rows = [[row.keys() for row in metrics_of(tmp_path / name)] for name in ("whole", "r")]
    assert rows[0] == rows[1]
