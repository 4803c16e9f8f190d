"""Retrain a victim, from the settings to the scores; resumable from the last checkpoint."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from apil_core.common.errors import RunDirError
from apil_core.config.absent import with_absent
from apil_core.evaluation.progress import Progress
from apil_core.plugins.defined import PolicyLike, as_text, policy_name
from apil_core.plugins.discovery import PluginRegistry
from apil_core.plugins.registry import plugins_with
from apil_core.runs.retraining.build import prepare
from apil_core.runs.retraining.config import VERSION, RetrainConfig
from apil_core.runs.retraining.folder import RetrainDir
from apil_core.runs.retraining.session import RetrainResult, RetrainSession
from apil_core.runs.retraining.settings import settings
from apil_core.runs.runner import changed, check_unfinished, go_back
from apil_core.training.distributed.world import ALONE
from apil_core.training.storage import checkpoint
from apil_core.training.storage.checkpoint import MAY_CHANGE, check_same_settings, fitting

_SHORT = {"physics": "game.physics", "episodes": "evaluation.episodes"}
"""Keywords named like flags of ``apil retrain``."""

_BY_HASH = ("victim", "adversaries", "baseline")
"""Settings that may change, too: policies are identified by their hashes, which are compared."""


def retrain(
    config: RetrainConfig | PolicyLike | Sequence[PolicyLike],
    *,
    out: Path | str | None = None,
    progress: Progress | None = None,
    command: Sequence[str] = (),
    plugins: PluginRegistry | None = None,
    **changes: Any,
) -> RetrainResult:
    """Harden a victim against adversaries, checkpointing on the way, and score it at the end.

    Args:
        config: the adversaries, runs first; or the settings, complete.
        out: directory; default ``runs/<env>/retrain/<opponents>/<time>-s<seed>``.
        progress: gets iterations, scores and notes.
        command: stored for reproducibility.
        plugins: registry to use; default: the installed ones and ``config.plugins``.
        changes: settings by key, as ``apil retrain`` has them: ``steps``, ``victim``, ``adversary_share``, …;
            ``physics`` and ``episodes`` are short for ``game.physics`` and ``evaluation.episodes``.

    Raises:
        ApilError: anything wrong in settings, weights or directory, before anything is played.
    """
    if not isinstance(config, RetrainConfig):
        values = {_SHORT.get(key, key): as_text(value) for key, value in changes.items()}
        named = config if isinstance(config, Sequence) and not isinstance(config, str) else [config]
        config = settings([policy_name(each) for each in named], values, plugins=plugins)
    registry = plugins or plugins_with(config.plugins)
    trainer = prepare(config, registry)
    place = None if out is None else Path(out)
    directory = RetrainDir.create(trainer.retraining, place, command, registry)
    with directory.lock():
        return RetrainSession(trainer, directory, progress or Progress(), registry).retrain()


def resume_retraining(
    directory: Path | str,
    *,
    steps: int | None = None,
    checkpoint_path: Path | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
    command: Sequence[str] = (),
    plugins: PluginRegistry | None = None,
) -> RetrainResult:
    """Resume a retraining exactly from its newest checkpoint; or extend a finished one.

    Args:
        directory: of the retraining.
        steps: new total of environment steps; default: as configured.
        checkpoint_path: continue from this one instead of the newest (later metrics are dropped).
        threads: physics threads for this session; never changes results.
        progress: gets iterations, scores and notes.
        command: stored in ``environment.json``.
        plugins: as for :func:`retrain`.

    Raises:
        RunDirError: no retraining there, one that an older version began, no readable checkpoint, one made
            with other settings, or nothing left to do.
        VictimError: a policy's weights have changed since the start.
    """
    space = RetrainDir(directory)
    stored = space.config()
    if stored.version != VERSION:
        raise RunDirError(
            f"{space.path} was begun by an older version; its victim stays retrained:{space.path}, which can "
            f"be retrained further: apil retrain RUN --victim retrained:{space.path}"
        )
    with space.lock():
        path = space.checkpoint(checkpoint_path)
        state = checkpoint.read(path)
        config = changed(stored, steps, threads)
        registry = plugins or plugins_with(config.plugins)
        _check_same(state, config, registry, path)
        check_unfinished(space, state, config, ALONE)
        trainer = prepare(config, registry)
        with fitting(path):
            trainer.load_state_dict(state)
        go_back(space, path, state)
        space.write_config(trainer.retraining, registry)
        space.note_environment(command)
        return RetrainSession(trainer, space, progress or Progress(), registry, state).retrain()


def _check_same(state: Mapping[str, Any], config: RetrainConfig, plugins: PluginRegistry, path: Path) -> None:
    ours = config.model_dump(mode="json")
    stored = state.get("config")
    theirs = with_absent(stored if isinstance(stored, Mapping) else {}, plugins, RetrainConfig)
    keys = set(ours) - set(MAY_CHANGE) - set(_BY_HASH) | {"victim_sha256"}
    check_same_settings(ours, theirs, keys, path)
