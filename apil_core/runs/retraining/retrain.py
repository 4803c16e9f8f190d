"""Retraining a victim, from the settings to the scores; stopped at any moment, it goes on from there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from apil_core.common.errors import ConfigError, RunDirError
from apil_core.config.absent import with_absent
from apil_core.config.problems import problems_of
from apil_core.evaluation.progress import Progress
from apil_core.plugins.discovery import PluginRegistry
from apil_core.plugins.registry import plugins_with
from apil_core.runs.retraining.build import prepare
from apil_core.runs.retraining.config import RetrainConfig
from apil_core.runs.retraining.folder import RetrainDir
from apil_core.runs.retraining.scoring import RetrainResult
from apil_core.runs.retraining.session import RetrainCourse
from apil_core.training.storage import checkpoint
from apil_core.training.storage.checkpoint import check_same_settings, fitting
from apil_core.training.storage.metrics_log import iterations_in_rows
from apil_core.training.storage.recorders import truncate_metrics

MAY_CHANGE = (
    *("steps", "threads", "device", "recorders", "checkpoint", "evaluation", "plugins", "trust"),
    *("victim", "adversaries", "baseline"),  # who plays is told by the weights: their hashes are compared
)
"""Settings that a retraining may change when it goes on."""


def retrain(
    config: RetrainConfig,
    *,
    out: Path | None = None,
    progress: Progress | None = None,
    command: Sequence[str] = (),
    plugins: PluginRegistry | None = None,
) -> RetrainResult:
    """Harden a victim as ``config`` says, checkpointing on the way, and score it at the end.

    Args:
        config: as :func:`apil_core.runs.retraining.settings.settings` gives it.
        out: directory; default ``runs/<env>/retrain/<opponents>/<time>-s<seed>``.
        progress: told how it goes.
        command: stored for people who ask where a victim came from.
        plugins: registry to use; default: the installed ones and ``config.plugins``.

    Raises:
        ApilError: anything wrong in settings, weights or directory, before anything is played.
    """
    registry = plugins or plugins_with(config.plugins)
    setting = prepare(config, registry)
    try:
        directory = RetrainDir.create(setting.config, out, command)
        with directory.files.lock():
            return RetrainCourse(setting, directory, progress or Progress(), registry).go()
    finally:
        setting.close()


def resume(
    directory: Path | str,
    *,
    steps: int | None = None,
    checkpoint_path: Path | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
    command: Sequence[str] = (),
    plugins: PluginRegistry | None = None,
) -> RetrainResult:
    """Go on with a retraining exactly where its newest checkpoint left it; or extend a finished one.

    Args:
        directory: of the retraining.
        steps: new total of environment steps; default: as configured.
        checkpoint_path: continue from this one instead of the newest (later metrics are dropped).
        threads: physics threads for this session; never changes results.
        progress: told how it goes.
        command: stored in ``environment.json``.
        plugins: as for :func:`retrain`.

    Raises:
        RunDirError: no retraining there, no readable checkpoint, one made with other settings, or nothing
            left to do.
        VictimError: somebody's weights have changed since it began.
    """
    space = RetrainDir(directory)
    files = space.files
    stored = space.config()
    with files.lock():
        path = checkpoint_path or files.newest_checkpoint()
        state = checkpoint.read(path)
        config = _changed(stored, steps, threads)
        registry = plugins or plugins_with(config.plugins)
        _check_same(state, config, registry, path)
        ended = (space.result() or {}).get("status") == "finished"
        if ended and state["steps"] >= config.steps:
            raise RunDirError(
                f"{space.path} is finished at {state['steps']} steps; to extend it: "
                f"apil resume {space.path} --steps N with N > {state['steps']}"
            )
        setting = prepare(config, registry)
        try:
            with fitting(path):
                setting.trainer.load_state_dict(state)
            truncate_metrics(files.metrics_path, iterations_in_rows(state))
            files.abandon_after(state["iteration"])
            files.retire_result(int(state["steps"]))
            space.write_config(setting.config)
            files.note_environment(command)
            course = RetrainCourse(setting, space, progress or Progress(), registry, state["before"])
            return course.go()
        finally:
            setting.close()


def _check_same(state: Mapping[str, Any], config: RetrainConfig, plugins: PluginRegistry, path: Path) -> None:
    ours = config.model_dump(mode="json")
    stored = state.get("config")
    theirs = with_absent(stored if isinstance(stored, Mapping) else {}, plugins, RetrainConfig)
    check_same_settings(ours, theirs, set(ours) - set(MAY_CHANGE), path)


def _changed(config: RetrainConfig, steps: int | None, threads: int | None) -> RetrainConfig:
    data = config.model_dump()
    data.update({key: v for key, v in (("steps", steps), ("threads", threads)) if v is not None})
    try:
        return RetrainConfig.model_validate(data)
    except ValidationError as error:
        problem = problems_of(error, RetrainConfig)[0]
        raise ConfigError(f"--{'.'.join(map(str, problem.key))}: {problem.reason}") from error
