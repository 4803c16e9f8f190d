"""``apil tune``: look for the settings of a training that win most, with Optuna."""

from __future__ import annotations

import subprocess
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from apil_core.api.config import RunConfig
from apil_core.common.errors import ConfigError
from apil_core.common.extras import need
from apil_core.common.files import write_atomically
from apil_core.common.machine import threads_each
from apil_core.config.resolve import complete, dump_yaml
from apil_core.evaluation.results import EvaluationResult
from apil_core.evaluation.score import evaluate
from apil_core.plugins.defined import defined
from apil_core.plugins.registry import plugins_with
from apil_core.runs.runner import prepared
from apil_core.studies.bench.supervised import start_supervised
from apil_core.studies.loaded_run import Media
from apil_core.studies.tune.space import TRIALS, Space
from apil_core.training.distributed.world import ALONE

if TYPE_CHECKING:
    from optuna import Study
    from pandas import DataFrame

    from apil_core.studies.tune.folder import StudyDir

ROOT = Path("runs") / "tune"
_EVALUATIONS = 10
"""Evaluations of a trial, unless ``evaluation.every_steps`` says otherwise."""


@dataclass(frozen=True)
class TuneResult:
    """A study so far.

    Attributes:
        path: its directory.
        status: ``interrupted`` if trials are left.
        best: the best trial's settings, as in ``best.yaml``; ``None`` before one is complete.
        number: of the best trial.
        win_rate: its win rate in its last evaluation during training.
        scores: final scores, on other games, of the ``best`` trial and of the settings as they were
            (``default``), if the study tried them.
        rows: of each trial ``number``, ``state`` (complete, pruned, failed, interrupted), ``win_rate``
            (of the last evaluation), ``run`` (its directory), ``error`` (of a failed one), and parameters.
    """

    path: Path
    status: Literal["finished", "interrupted"]
    best: RunConfig | None
    number: int | None
    win_rate: float | None
    scores: dict[str, EvaluationResult]
    rows: list[dict[str, Any]]

    @property
    def trials(self) -> DataFrame:
        """The trials as a pandas frame, a row each."""
        frame: DataFrame = need("pandas").DataFrame(self.rows)
        return frame.set_index("number")

    def plot(self) -> Media:
        """The win rates of all trials, in their order."""
        return Media((self.path / "history.png").read_bytes(), "image/png")


def tune(
    space: PathLike[str] | str | Mapping[str, Any],
    config: RunConfig,
    *,
    trials: int | None = None,
    workers: int = 1,
    out: PathLike[str] | str | None = None,
    note: Callable[[str], None] | None = None,
) -> TuneResult:
    """Train with many settings, end what falls behind, and score the best.

    Args:
        space: a file, a shipped space's name, or the content, e.g.
            ``{"ppo.clip": {"low": 0.1, "high": 0.4}, "ppo.noise": ["white", "ar1"]}``.
        config: what all trials share, see :class:`apil_core.RunConfig`.
        trials: in all, those of earlier calls with the same ``out`` included; default: as many as the last
            call asked for, or 20.
        workers: processes.
        out: directory; default ``runs/tune/<env>/<method>``. Continued if it exists.
        note: gets a line for each trial.

    Raises:
        ApilError: anything wrong in space, config, plugins, weights or directory, before training starts.
    """
    from apil_core.studies.tune.folder import StudyDir

    registry = plugins_with(config.plugins)
    config = evaluated(complete(config, registry))
    directory = StudyDir(ROOT / config.env / config.method if out is None else Path(out))
    return run_study(directory, Space(space, config, registry), trials, workers, note)


def evaluated(config: RunConfig) -> RunConfig:
    """The configuration with evaluations during training.

    Raises:
        ConfigError: there would be none.
    """
    every = config.evaluation.every_steps or max(config.steps // _EVALUATIONS, 1)
    if every > config.steps:
        raise ConfigError(
            f"evaluation.every_steps ({every}) is above steps ({config.steps}): no trial has a score"
        )
    evaluation = config.evaluation.model_copy(update={"every_steps": every})
    return config.model_copy(update={"evaluation": evaluation})


def run_study(
    directory: StudyDir, space: Space, trials: int | None, workers: int, note: Callable[[str], None] | None
) -> TuneResult:
    """Begin or continue a study; see :func:`tune`."""
    from apil_core.studies.tune.work import work

    need("optuna", "matplotlib")
    if workers > 1 and space.config.method in defined:
        raise ConfigError(f"method {space.config.method!r} is this process's: workers must be 1")
    trainer, _ = prepared(space.config, space.plugins, ALONE)  # every check of a run, once
    trainer.close()
    space.config = trainer.config.model_copy(update={"threads": space.config.threads})
    with directory.lock():
        directory.begin(space)
        study = directory.study()
        if (default := space.default()) is not None:
            study.enqueue_trial(default, user_attrs={"default": True}, skip_if_exists=True)
        trials = trials or int(study.user_attrs.get("trials", TRIALS))
        study.set_user_attr("trials", trials)
        threads = space.config.threads or threads_each(workers)
        with _helpers(workers - 1, directory.path, trials, threads, quiet=note is None) as wait:
            done = work(directory, space, trials, threads, note or str) and wait()
        try:
            if done and workers > 1:  # what a worker that crashed has left
                done = work(directory, space, trials, threads, note or str)
            _finish(directory, space, study, done)
        except KeyboardInterrupt:
            done = False
        return _result(directory, space, study, done)


@contextmanager
def _helpers(
    count: int, path: Path, trials: int, threads: int, *, quiet: bool
) -> Iterator[Callable[[], bool]]:
    """Further workers; yields a function that waits for their end, and returns false after Ctrl-C."""
    helpers = [_helper(path, trials, threads, quiet) for _ in range(count)]

    def wait() -> bool:
        try:
            for helper in helpers:
                helper.wait()
        except KeyboardInterrupt:
            return False
        return True

    try:
        yield wait
    finally:
        for helper in helpers:
            assert helper.stdin is not None
            helper.stdin.close()
        for helper in helpers:
            helper.wait()


def _helper(path: Path, trials: int, threads: int, quiet: bool) -> subprocess.Popen[bytes]:
    """Start a worker process; it stops with a checkpoint when its standard input closes."""
    words = ["tune", str(path), "--worker", "--trials", str(trials), "--threads", str(threads)]
    return start_supervised([*words, *(["--quiet"] if quiet else [])], stdout=subprocess.DEVNULL)


def _finish(directory: StudyDir, space: Space, study: Study, done: bool) -> None:
    """Draw the study, and score its best trial once it is over."""
    if _complete(study):
        _draw(study, directory.path)
        text = dump_yaml(_best(directory, space, study), space.plugins)
        write_atomically(directory.best_path, lambda file: file.write(text.encode()))
        for number in _scored(study).values() if done and space.config.evaluation.episodes else ():
            run = directory.run(number)
            if (result := run.result() or {}).get("evaluation") is None:
                games, seed = space.config.evaluation.episodes, space.config.seed
                score = evaluate(run.path, episodes=games, seed=seed, threads=space.config.threads)
                run.write_json(run.result_path, {**result, "evaluation": score.model_dump(mode="json")})


def _result(directory: StudyDir, space: Space, study: Study, done: bool) -> TuneResult:
    from apil_core.studies.tune.work import state_of

    rows: list[dict[str, Any]] = []
    for trial in study.trials:
        if trial.params:  # else not begun
            found = {"number": trial.number, "state": state_of(trial.state), "win_rate": trial.value}
            extra = {"run": str(directory.run(trial.number).path), "error": trial.user_attrs.get("error", "")}
            rows.append({**found, **extra, **trial.params})
    scores = {}
    for name, number in _scored(study).items():
        if evaluation := (directory.run(number).result() or {}).get("evaluation"):
            scores[name] = EvaluationResult.model_validate(evaluation)
    best = study.best_trial if _complete(study) else None
    return TuneResult(
        directory.path,
        "finished" if done else "interrupted",
        _best(directory, space, study) if best else None,
        best.number if best else None,
        best.value if best else None,
        scores,
        rows,
    )


def _complete(study: Study) -> list[Any]:
    return [trial for trial in study.trials if trial.state.name == "COMPLETE"]


def _scored(study: Study) -> dict[str, int]:
    """Numbers of the trials that have a final score."""
    done = _complete(study)
    own = [("default", trial.number) for trial in done if trial.user_attrs.get("default")]
    return dict([("best", study.best_trial.number), *own]) if done else {}


def _best(directory: StudyDir, space: Space, study: Study) -> RunConfig:
    """Settings of the best trial, with the final score that trials lack."""
    stored = directory.run(study.best_trial.number).config()
    own = {key: getattr(space.config, key) for key in ("evaluation", "threads")}
    return stored.model_copy(update={**own, "victim_sha256": ""})


def _draw(study: Study, folder: Path) -> None:
    """Draw ``history.png``, and from two complete trials on ``importances.png``."""
    plt, optuna_plots = need("matplotlib.pyplot"), need("optuna.visualization.matplotlib")
    with warnings.catch_warnings(), plt.rc_context():
        warnings.simplefilter("ignore")  # Optuna calls its pictures experimental
        made = {"history": optuna_plots.plot_optimization_history(study, target_name="win rate")}
        if len(_complete(study)) > 1:
            made["importances"] = optuna_plots.plot_param_importances(study, target_name="win rate")
        for name, axes in made.items():
            axes.figure.savefig(folder / f"{name}.png", dpi=150, bbox_inches="tight")
            plt.close(axes.figure)
