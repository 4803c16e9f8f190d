"""Running an attack from start to end, or on from a checkpoint: directories, recorders, signals, scores."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import Any, Literal

from pydantic import BaseModel

from apil_core import checkpoint
from apil_core.build import build, victim_name
from apil_core.config import RunConfig
from apil_core.config_io import complete
from apil_core.errors import ApilError, ConfigError, RunDirError, UnknownNameError
from apil_core.evaluation import EvaluationResult
from apil_core.files import sha256
from apil_core.plugins import PluginRegistry, discover
from apil_core.progress import Progress
from apil_core.recorders import truncate_metrics
from apil_core.registry import default_plugins
from apil_core.rundir import RunDir
from apil_core.specs import load
from apil_core.torch_threads import one_torch_thread
from apil_core.trainer import Trainer


class RunResult(BaseModel):
    """How a run ended."""

    run_dir: Path
    status: Literal["finished", "interrupted"]
    steps: int
    wall_seconds: float
    evaluation: EvaluationResult | None = None


def run(
    config: RunConfig,
    *,
    out: Path | None = None,
    progress: Progress | None = None,
    command: Sequence[str] = (),
    plugins: PluginRegistry | None = None,
) -> RunResult:
    """Train an adversary as ``config`` says, checkpointing on the way, and score it at the end.

    Args:
        config: see :class:`apil_core.RunConfig`.
        out: run directory; default ``runs/<env>/<method>/<time>-s<seed>``.
        progress: who is told how it goes.
        command: stored for people who ask where a number came from.
        plugins: registry to use; default: the installed ones and ``config.plugins``.

    Raises:
        ApilError: anything wrong in config, plugins, weights or directory, before training starts.
    """
    registry = plugins or _plugins(config)
    config = complete(config, registry)
    trainer = _trainer(config, registry)
    if config.init_from is not None:
        _initialise(trainer, config.init_from)
    run_dir = RunDir.create(trainer.config, out, command, registry)
    return _Session(trainer, run_dir, progress or Progress(), registry).go()


def resume(
    run_dir: Path | str,
    *,
    steps: int | None = None,
    checkpoint_path: Path | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
    command: Sequence[str] = (),
) -> RunResult:
    """Continue a run exactly where its newest checkpoint left it; or extend a finished one.

    Args:
        run_dir: directory of the run.
        steps: new total of environment steps; default: as configured.
        checkpoint_path: continue from this one instead of the newest (later metrics are dropped).
        threads: physics threads for this session; never changes results.
        progress: who is told how it goes.
        command: stored in ``environment.json``.

    Raises:
        RunDirError: no run there, no readable checkpoint, or nothing left to do.
    """
    directory = RunDir(run_dir)
    config = directory.config()
    state = checkpoint.read(checkpoint_path or directory.newest_checkpoint(), config.device)
    if steps is not None:
        config = config.model_copy(update={"steps": steps})
    if threads is not None:
        config = config.model_copy(update={"threads": threads})
    # a run killed during its final evaluation has all its steps but no result yet
    if state["steps"] >= config.steps and (directory.result() or {}).get("status") == "finished":
        raise RunDirError(
            f"{directory.path} is finished at {state['steps']} steps; to extend it: "
            f"apil resume {directory.path} --steps N with N > {state['steps']}"
        )
    registry = _plugins(config)
    trainer = _trainer(config, registry)
    trainer.load_state_dict(state)
    directory.write_config(config, registry)
    directory.note_environment(command)
    truncate_metrics(directory.metrics_path, state["iteration"])
    return _Session(trainer, directory, progress or Progress(), registry).go()


def _plugins(config: RunConfig) -> PluginRegistry:
    return discover(config.plugins) if config.plugins else default_plugins()


def _trainer(config: RunConfig, registry: PluginRegistry) -> Trainer:
    for name in config.recorders:
        if name not in registry.recorders:
            raise UnknownNameError("recorder", name, registry.recorders)
    return Trainer(build(config, registry), registry)


def _initialise(trainer: Trainer, source: Path) -> None:
    directory = RunDir(source)
    theirs = directory.config()
    if theirs.env != trainer.config.env:
        raise ConfigError(f"init_from: {source} was trained on {theirs.env}, not {trainer.config.env}")
    state = checkpoint.read(directory.newest_checkpoint(), trainer.config.device)
    mine = trainer.attack.builder.sizes
    if state["groups"] != mine or theirs.ppo.hidden != trainer.config.ppo.hidden:
        raise ConfigError(
            f"init_from: {source} has observation groups {state['groups']} and hidden layers "
            f"{theirs.ppo.hidden}, this run {mine} and {trainer.config.ppo.hidden}"
        )
    trainer.start_from(state)


class _Session:
    """One stretch of a run between start and finish, Ctrl-C or crash."""

    def __init__(self, trainer: Trainer, run_dir: RunDir, progress: Progress, plugins: PluginRegistry):
        self.trainer = trainer
        self.run_dir = run_dir
        self.progress = progress
        self.config = trainer.config
        self.recorders = [
            load(plugins.recorders[name].factory)(run_dir.path) for name in self.config.recorders
        ]
        self.victim = victim_name(self.config, plugins)
        self._saved_iteration = -1
        self._stop = False

    def go(self) -> RunResult:
        trainer, hooks = self.trainer, self.trainer.attack.hooks
        self.progress.started(self.config, self.run_dir.path, self.victim, trainer.steps)
        status: Literal["finished", "interrupted"] = "interrupted"
        evaluation = None
        try:
            with hooks.attribution(), self._stop_on_signal(), one_torch_thread():
                hooks.hook.run_started(run=trainer)
                while not trainer.finished and not self._stop:
                    self._iteration()
                self.save()
                if trainer.finished and not self._stop:
                    evaluation = self._final_evaluation()
                    hooks.hook.run_finished(run=trainer)
                    status = "finished"
        except _Stopped:
            pass  # in the final evaluation: the checkpoint is written already
        except RunDirError:
            raise
        except Exception as error:
            self._note_failure(error)
            raise
        finally:
            self._close()
        return self._result(status, evaluation)

    def _iteration(self) -> None:
        trainer = self.trainer
        before = trainer.steps
        metrics = trainer.iterate()
        every = self.config.evaluation.every_steps
        if every and before // every < trainer.steps // every:
            with suppress(_Stopped):
                result = self._evaluate(self.config.evaluation.periodic_episodes)
                metrics.update(_evaluation_metrics(result))
        for recorder in self.recorders:
            recorder.record(metrics)
        self.progress.iteration(metrics)
        trainer.attack.hooks.hook.iteration_finished(run=trainer, metrics=metrics)
        if trainer.iteration % self.config.checkpoint.every_iterations == 0:
            self.save()

    def save(self) -> None:
        """Write a checkpoint of this iteration boundary (once) and drop the oldest."""
        iteration = self.trainer.iteration
        if self._saved_iteration == iteration:
            return
        checkpoint.save(self.run_dir.checkpoint_path(iteration), self.trainer.state_dict())
        self._saved_iteration = iteration
        self.run_dir.prune(self.config.checkpoint.keep)

    def _note_failure(self, error: Exception) -> None:
        newest = self.run_dir.checkpoints()
        where = f"; continue from the last checkpoint with: apil resume {self.run_dir.path}" if newest else ""
        message = f"stopped at iteration {self.trainer.iteration + 1} by an error{where}"
        self.progress.note(message)
        with suppress(ApilError):
            self.run_dir.write_json(
                self.run_dir.result_path,
                {"status": "failed", "steps": self.trainer.steps, "error": str(error)},
            )

    def _evaluate(self, episodes: int) -> EvaluationResult:
        result = self.trainer.evaluate(episodes, _StoppableProgress(self))
        self.progress.evaluation(result, self.trainer.steps)
        return result

    def _final_evaluation(self) -> EvaluationResult | None:
        episodes = self.config.evaluation.episodes
        if not episodes:
            return None
        result = self._evaluate(episodes)
        path = self.run_dir.checkpoint_path(self.trainer.iteration)
        result.adversary.name = f"run:{self.run_dir.path}"
        result.adversary.sha256 = sha256(path)
        return result

    def _result(
        self, status: Literal["finished", "interrupted"], evaluation: EvaluationResult | None
    ) -> RunResult:
        result = RunResult(
            run_dir=self.run_dir.path,
            status=status,
            steps=self.trainer.steps,
            wall_seconds=self.trainer.wall_seconds,
            evaluation=evaluation,
        )
        self.run_dir.write_json(self.run_dir.result_path, result.model_dump(mode="json"))
        return result

    def _close(self) -> None:
        for recorder in self.recorders:
            recorder.close()
        self.progress.finished(self.run_dir.path)
        self.trainer.attack.game.close()

    @contextmanager
    def _stop_on_signal(self) -> Iterator[None]:
        """First Ctrl-C (or SIGTERM): finish the iteration, checkpoint, return. Second: at once."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return

        def handle(number: int, frame: FrameType | None) -> None:
            if self._stop:
                raise KeyboardInterrupt
            self._stop = True
            self.progress.note("stopping after this iteration, with a checkpoint (once more: at once)")

        previous = {number: signal.signal(number, handle) for number in (signal.SIGINT, signal.SIGTERM)}
        try:
            yield
        finally:
            for number, old in previous.items():
                signal.signal(number, old)


class _Stopped(Exception):  # noqa: N818  (no error: the user asked for it)
    """Ctrl-C during an evaluation."""


class _StoppableProgress(Progress):
    """Passes an evaluation's progress on, and breaks it off when the session is to stop."""

    def __init__(self, session: _Session):
        self._session = session

    def evaluation_progress(self, done: int, total: int) -> None:
        if self._session._stop:
            raise _Stopped
        self._session.progress.evaluation_progress(done, total)


def _evaluation_metrics(result: EvaluationResult) -> dict[str, float]:
    rates: dict[str, Any] = {
        "win": result.win_rate,
        "tie": result.tie_rate,
        "loss": result.loss_rate,
        "win_or_tie": result.win_or_tie_rate,
    }
    metrics: dict[str, float] = {"evaluation/episodes": result.episodes}
    for name, rate in rates.items():
        metrics[f"evaluation/{name}"] = rate.value
        metrics[f"evaluation/{name}_low"] = rate.low
        metrics[f"evaluation/{name}_high"] = rate.high
    return metrics
