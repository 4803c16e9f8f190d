"""A worker of a study: one trial after the other, each a run, until all have been begun."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable
from typing import Any

from optuna import Study, Trial
from optuna.trial import TrialState

from apil_core.api.config import RunConfig
from apil_core.api.method import Callback, Run
from apil_core.common.errors import ConfigError, RunDirError, failures
from apil_core.plugins.discovery import PluginRegistry
from apil_core.runs import runner
from apil_core.studies.tune.folder import StudyDir
from apil_core.studies.tune.space import Space
from apil_core.training.storage.run_dir import RunDir

_PRUNED = "pruned"
_BETWEEN = 30.0
"""Seconds between lines on a long trial."""


class Pruning(Callback):
    """Reports each evaluation's win rate to a study, and ends its trial when the pruner says so.

    Evaluations count from 1, so that trials of other batch sizes are compared at the same place.
    """

    def __init__(self, study: Study, trial: Trial, note: Callable[[str], object]):
        self._trial = trial
        self._note, self._next_note = note, time.monotonic() + _BETWEEN
        self._reported = set(study.trials[trial.number].intermediate_values)

    def evaluation_finished(self, run: Run, result: dict[str, Any]) -> None:
        """Report; stop the run unless it ends here anyway."""
        count, rate = run.steps // run.config.evaluation.every_steps, result["win_rate"]["value"]
        if count not in self._reported:  # else played again after a crash, with the same result
            self._trial.report(rate, count)
        if run.steps < run.total_steps and self._trial.should_prune():
            run.stop(f"{_PRUNED} at {rate:.1%} wins, evaluation {count}")
        if time.monotonic() > self._next_note:
            self._next_note = time.monotonic() + _BETWEEN
            self._note(
                f"trial {self._trial.number}: {rate:.1%} wins, {run.steps:,} of {run.total_steps:,} steps"
            )


def work(directory: StudyDir, space: Space, trials: int, threads: int, note: Callable[[str], object]) -> bool:
    """Do trials until none is left to begin or to continue.

    Args:
        directory: the study's.
        space: its search space.
        trials: of the study in all.
        threads: of physics; never changes results.
        note: gets a line at each trial's end.

    Returns:
        false after Ctrl-C; the trial in progress has a checkpoint then.
    """
    study = directory.study()
    try:
        while True:
            with directory.next_trial(study, trials) as trial:
                if trial is None:
                    return True
                if not _run(directory, space, study, trial, threads, note):
                    return False
            note(describe(study, trial.number))
    except KeyboardInterrupt:
        return False


def describe(study: Study, number: int) -> str:
    """How a trial ended, and the best so far."""
    trial = study.trials[number]
    rate = "no score" if trial.value is None else f"{trial.value:.1%} wins"
    error = f": {trial.user_attrs['error']}" if "error" in trial.user_attrs else ""
    done = study.get_trials(deepcopy=False, states=(TrialState.COMPLETE,))
    best = f"; best {study.best_value:.1%} (trial {study.best_trial.number})" if done else ""
    return f"trial {number} {state_of(trial.state)}, {rate}{error}{best}"


def state_of(state: TrialState) -> str:
    """``complete``, ``pruned``, ``failed`` or ``interrupted``."""
    return {"FAIL": "failed", "RUNNING": "interrupted"}.get(state.name, state.name.lower())


def _run(
    directory: StudyDir, space: Space, study: Study, trial: Trial, threads: int, note: Callable[[str], object]
) -> bool:
    """Train a trial, or continue it from its checkpoint; return false after Ctrl-C."""
    run = directory.run(trial.number)
    try:
        config = space.suggest(trial)
        result = run.result() or {}
        if result.get("status") != "finished":  # else killed before the study was told
            result = _train(config, run, threads, Pruning(study, trial, note), space.plugins)
        rates = study.trials[trial.number].intermediate_values
        if result["status"] == "finished" and not rates:
            raise ConfigError("ended before its first evaluation")
    except RunDirError:  # the disk's fault, not the settings': the trial can be continued
        raise
    except failures() as error:
        trial.set_user_attr("error", " ".join(str(error).split()) or type(error).__name__)
        study.tell(trial, state=TrialState.FAIL)
        return True
    if result["status"] == "interrupted":
        return False
    if str(result["stopped"]).startswith(_PRUNED):
        study.tell(trial, state=TrialState.PRUNED)
    else:
        study.tell(trial, rates[max(rates)])
    return True


def _train(
    config: RunConfig, run: RunDir, threads: int, pruning: Pruning, plugins: PluginRegistry
) -> dict[str, Any]:
    if run.checkpoints():
        return runner.resume(run.path, threads=threads, callbacks=[pruning]).model_dump()
    shutil.rmtree(run.path, ignore_errors=True)  # killed before its first checkpoint
    evaluation = config.evaluation.model_copy(update={"episodes": 0})  # the final score is the best trial's
    config = config.model_copy(update={"threads": threads, "evaluation": evaluation})
    return runner.run(config, out=run.path, callbacks=[pruning], plugins=plugins).model_dump()
