"""Start an attack, or resume one from a checkpoint; all is checked before training begins."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from typing import Any, TypeVar

from pydantic import ValidationError

from apil_core.api.config import RunConfig
from apil_core.api.method import Callback, Method
from apil_core.api.policy import Policy
from apil_core.api.specs import MethodSpec, load
from apil_core.common.errors import ConfigError, RunDirError, UnknownNameError
from apil_core.common.torch_threads import one_torch_thread
from apil_core.config.absent import completed
from apil_core.config.kind import IsRetrainingError
from apil_core.config.layers import POLICY_NAME
from apil_core.config.resolve import complete
from apil_core.evaluation.progress import Progress
from apil_core.plugins.callbacks import with_callbacks
from apil_core.plugins.defined import define
from apil_core.plugins.discovery import PluginRegistry
from apil_core.plugins.registry import plugins_with
from apil_core.runs.best import EvaluationHistory
from apil_core.runs.session import RunResult as RunResult
from apil_core.runs.session import Session
from apil_core.runs.warm_start import load_teacher
from apil_core.training.build import build
from apil_core.training.distributed.join import joined
from apil_core.training.distributed.world import ALONE, World
from apil_core.training.storage import checkpoint
from apil_core.training.storage.checkpoint import check_same_run, check_same_world, fitting
from apil_core.training.storage.metrics_log import iterations_in_rows
from apil_core.training.storage.recorders import truncate_metrics
from apil_core.training.storage.run_dir import RunDir, part_of_rank
from apil_core.training.trainer import Trainer

Config = TypeVar("Config", bound=RunConfig)
_SHAPE = ("hidden", "action_unit", "critic_observes")
"""PPO settings that determine the networks' shapes, inputs and units."""


@one_torch_thread()
def run(
    config: RunConfig,
    *,
    out: Path | str | None = None,
    methods: Sequence[type[Method] | MethodSpec] = (),
    callbacks: Sequence[Callback] = (),
    progress: Progress | None = None,
    command: Sequence[str] = (),
    plugins: PluginRegistry | None = None,
) -> RunResult:
    """Train an adversary with ``config``, checkpointing on the way, and score it at the end.

    Started by torchrun, all its processes train together (docs/distributed.md).

    Args:
        config: see :class:`apil_core.RunConfig`.
        out: run directory; default ``runs/<env>/<method>/<time>-s<seed>``.
        methods: classes of this session (see :func:`apil_core.define`), required ones first. The last is
            trained, unless ``config.method`` names another of them.
        callbacks: see :class:`apil_core.Callback`.
        progress: gets iterations, scores and notes.
        command: stored for reproducibility.
        plugins: registry to use; default: the installed ones and ``config.plugins``.

    Raises:
        ApilError: anything wrong in config, plugins, weights or directory, before training starts.
    """
    config = _trained_by(config, define(*methods))
    registry, acting = with_callbacks(lambda: plugins or plugins_with(config.plugins), callbacks)
    config = config.model_copy(update={"observers": (*config.observers, *acting)})
    # settings copied from another run bring the hash of that one's victim along
    config = complete(config, registry).model_copy(update={"victim_sha256": ""})
    with joined(config.device) as world:
        trainer, teacher = prepared(config, registry, world)
        trainer.start_equal()
        place = None if out is None else Path(out)
        made = RunDir.create(trainer.config, place, command, registry).path if world.is_main else None
        run_dir = RunDir(world.share(made) or "")
        with _held(run_dir, world):
            return Session(trainer, run_dir, progress or Progress(), registry).run(teacher)


def prepared(config: RunConfig, plugins: PluginRegistry, world: World) -> tuple[Trainer, Policy | None]:
    """Build the parts of a new run, and load the policy that its adversary is cloned from, if there is one.

    Raises:
        ApilError: they do not fit.
    """
    trainer, start = _trainer(config, plugins, world), config.init_from
    if start and POLICY_NAME.match(start):
        return trainer, load_teacher(trainer, start)
    if start:
        _initialise(trainer, Path(start))
    return trainer, None


@one_torch_thread()
def resume(
    run_dir: Path | str,
    *,
    steps: int | None = None,
    checkpoint_path: Path | None = None,
    threads: int | None = None,
    methods: Sequence[type[Method] | MethodSpec] = (),
    callbacks: Sequence[Callback] = (),
    progress: Progress | None = None,
    command: Sequence[str] = (),
) -> RunResult:
    """Resume a run exactly from its newest checkpoint; or extend a finished one.

    Args:
        run_dir: directory of the run.
        steps: new total of environment steps; default: as configured.
        checkpoint_path: continue from this one instead of the newest (later metrics are dropped); ``best``
            is the one that won most in evaluations during training.
        threads: of physics, and of the update (two at most), for this session; never changes results.
        methods, callbacks: those of the run that are classes and objects of a Python session.
        progress: gets iterations, scores and notes.
        command: stored in ``environment.json``.

    Raises:
        RunDirError: no run there, no readable checkpoint, or nothing left to do.
    """
    directory = RunDir(run_dir)
    try:
        stored = directory.config()
    except IsRetrainingError as error:
        raise IsRetrainingError(f"{error}; resume_retraining goes on with it") from error
    define(*methods)
    registry, _ = with_callbacks(lambda: plugins_with(stored.plugins), callbacks)
    stored = completed(stored, registry)
    with joined(stored.device) as world, _held(directory, world):
        path = world.share(directory.checkpoint(checkpoint_path))
        if path.resolve() == directory.best_path.resolve() and world.size > 1:
            raise RunDirError(
                f"{path} has the first process's part only: it can be scored, but not be gone on from"
            )
        state = _read(path, stored, registry, world)
        config = changed(stored, steps, threads)
        ended = check_unfinished(directory, state, config, world)
        trainer = _trainer(config, registry, world)
        with fitting(path):
            trainer.load_state_dict(state)
        if not ended and config.steps == stored.steps:  # only the final score is missing
            trainer.stopped = state.get("stopped", "")
        world.wait()  # until all have read the files that the first process now changes
        if world.is_main:
            go_back(directory, path, state)
            directory.write_config(trainer.config, registry)
            directory.note_environment(command)
        progress = progress or Progress()
        if config.steps != stored.steps:
            _note_changed_schedules(trainer, progress)
        log, scores = state.get("pending_rows", ()), state.get("evaluations", ())
        return Session(trainer, directory, progress, registry, log, scores).run()


def _trained_by(config: RunConfig, methods: Sequence[str]) -> RunConfig:
    """``config`` for the last of these methods, unless it names one of them already."""
    if not methods or config.method in methods:
        return config
    return config.model_copy(update={"method": methods[-1], "options": {}})


@contextmanager
def _held(directory: RunDir, world: World) -> Iterator[None]:
    """Hold the directory's lock; the first process takes it for all."""
    with directory.lock() if world.is_main else nullcontext():
        world.wait()
        yield


def _read(path: Path, stored: RunConfig, registry: PluginRegistry, world: World) -> dict[str, Any]:
    """Read this process's part of the checkpoint."""
    state = checkpoint.read(path)
    check_same_run(state, stored, registry, path)
    check_same_world(state, world, path)
    return state if world.is_main else checkpoint.read(part_of_rank(path, world.rank))


def go_back(directory: RunDir, path: Path, state: dict[str, Any]) -> None:
    """Set aside what the run wrote after the checkpoint at ``path``, from which it takes another course."""
    truncate_metrics(directory.metrics_path, iterations_in_rows(state))
    own = directory.checkpoint_path(state["iteration"])
    if path.resolve() != own.resolve():  # the best, or a copy: a stop before the next one must be resumable
        checkpoint.save(own, state)
    directory.abandon_after(state["iteration"])
    _abandon_best_after(directory.best_path, state["steps"])
    history = EvaluationHistory(state.get("evaluations", ()))
    if history.is_best(state["steps"]):  # it may have been killed before it wrote this
        checkpoint.save(directory.best_path, state)
    directory.retire_result(int(state["steps"]))


def _abandon_best_after(path: Path, steps: int) -> None:
    """Rename a best checkpoint that is later than the point of resumption."""
    if path.is_file():
        taken = math.inf
        with suppress(RunDirError):  # a damaged one must not prevent resuming
            taken = checkpoint.read(path)["steps"]
        if taken > steps:
            path.replace(path.with_name(f"{path.name}.abandoned"))


def check_unfinished(directory: RunDir, state: dict[str, Any], config: RunConfig, world: World) -> bool:
    """Return whether the run ended early; raise if it ended with its whole budget."""
    result = directory.result() or {}
    # a run killed during its final evaluation has all its steps but no result for them yet
    ended = result.get("status") == "finished" and result.get("steps") == state["steps"]
    if state["steps"] >= config.steps and ended:
        raise RunDirError(
            f"{directory.path} is finished at {state['steps']} steps; to extend it: "
            f"{world.command} resume {directory.path} --steps N with N > {state['steps']}"
        )
    return bool(ended)


def changed(config: Config, steps: int | None, threads: int | None) -> Config:
    """Return ``config`` with another budget or number of threads.

    Raises:
        ConfigError: the value is not allowed.
    """
    data = config.model_dump()
    data.update({key: v for key, v in (("steps", steps), ("threads", threads)) if v is not None})
    try:
        return type(config).model_validate(data)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(map(str, first["loc"]))
        raise ConfigError(f"--{key} {first['input']}: {first['msg']}") from error


def _note_changed_schedules(trainer: Trainer, progress: Progress) -> None:
    """Print a note if a new number of steps changes the slope of a schedule already in progress."""
    bent = []
    if trainer.config.ppo.lr_schedule == "linear":
        bent.append("ppo.learning_rate")
    if trainer.attack.env.weights.anneal_fraction > 0 and not trainer.config.reward.anneal_budget:
        bent.append("the dense reward's share")
    if bent:
        progress.note(f"a new number of steps changes the slope of {' and '.join(bent)} from here on")


def _trainer(config: RunConfig, registry: PluginRegistry, world: World) -> Trainer:
    check_recorders(config, registry, world)
    return Trainer(build(config, registry, world=world), registry)


def check_recorders(config: RunConfig, registry: PluginRegistry, world: World = ALONE) -> None:
    """Check that all recorders are installed and can write.

    Raises:
        ApilError: one is not.
    """
    for name in config.recorders:
        if name not in registry.recorders:
            raise UnknownNameError("recorder", name, registry.recorders)
        if registry.recorders[name].check and world.is_main:
            load(registry.recorders[name].check)()


def _initialise(trainer: Trainer, source: Path) -> None:
    directory = RunDir(source)
    theirs = directory.config()
    if theirs.env != trainer.config.env:
        raise ConfigError(f"init_from: {source} was trained on {theirs.env}, not {trainer.config.env}")
    path = directory.newest_checkpoint()
    state = checkpoint.read(path)
    shapes = [
        {"observation groups": groups} | {key: getattr(ppo, key) for key in _SHAPE}
        for groups, ppo in (
            (state["groups"], theirs.ppo),
            (trainer.attack.builder.sizes, trainer.config.ppo),
        )
    ]
    for key, there in shapes[0].items():
        if there != (here := shapes[1][key]):
            raise ConfigError(
                f"init_from: {source} has {key} {there}, this run {here}; "
                f"to clone its adversary: --init-from run:{source}"
            )
    with fitting(path):
        trainer.start_from(state)
