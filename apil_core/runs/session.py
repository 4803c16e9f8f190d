"""One session of a run: iterations, checkpoints, recorders, signals, and the score at the end."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel

from apil_core.api.method import RunPlugin
from apil_core.api.policy import Policy
from apil_core.common.documents import EXACT
from apil_core.common.errors import ApilError, RunDirError, failures
from apil_core.common.files import sha256
from apil_core.common.machine import resident_mb
from apil_core.common.seeds import stream_seed
from apil_core.common.torch_threads import one_torch_thread
from apil_core.evaluation.progress import Progress
from apil_core.evaluation.results import EvaluationResult
from apil_core.plugins.discovery import PluginRegistry
from apil_core.policies.loading import victim_name
from apil_core.runs.best import EvaluationHistory
from apil_core.runs.score import score_in_training
from apil_core.runs.stop_signal import Stopped, StopRequest
from apil_core.runs.warm_start import beside_teacher, warm_start
from apil_core.training.distributed.join import in_contact
from apil_core.training.plugin_state import states_of
from apil_core.training.storage import checkpoint
from apil_core.training.storage.metrics_log import Row, RowLog, iterations_per_row, open_recorders
from apil_core.training.storage.run_dir import RunDir, part_of_rank
from apil_core.training.trainer import Trainer

Status = Literal["finished", "interrupted"]

_LONG = 3600.0
"""Remaining training time from which on it is announced, s."""


class RunResult(BaseModel):
    """The result of a run."""

    model_config = EXACT

    run_dir: Path
    status: Literal["finished", "interrupted"]
    steps: int
    wall_seconds: float
    stopped: str = ""
    """Reason why training ended before its budget was used up; empty if it did not."""
    best: dict[str, Any] | None = None
    """The evaluation during training that won most (``steps``, ``games``, ``wins``, ``low``), if any."""
    evaluation: EvaluationResult | None = None
    white_box: bool = False
    """The method saw inside the victim."""

    def __fspath__(self) -> str:
        """The run's directory: a result may stand wherever one does."""
        return str(self.run_dir)


class Session:
    """A run between start and finish, Ctrl-C or crash.

    Of several processes that train together each has one; only the first one's says, evaluates and
    records anything.

    Args:
        pending_rows: the checkpoint's metrics that are in no row of the log yet.
        evaluations: of an earlier stretch, as the checkpoint has them.
    """

    def __init__(
        self,
        trainer: Trainer,
        run_dir: RunDir,
        progress: Progress,
        plugins: PluginRegistry,
        pending_rows: Iterable[Row] = (),
        evaluations: Iterable[dict[str, Any]] = (),
    ):
        self.trainer = trainer
        self.run_dir = run_dir
        self.progress = progress
        self.config = trainer.config
        self.world = trainer.world
        names = self.config.recorders if self.world.is_main else ()
        recorders = open_recorders([plugins.recorders[name] for name in names], run_dir.path)
        self.log = RowLog(recorders, iterations_per_row(self.config), pending_rows, progress.note)
        # the best evaluation is only useful while its checkpoint exists
        self.history = EvaluationHistory(evaluations if run_dir.best_path.is_file() else ())
        self.victim = victim_name(self.config, plugins)
        self._held, self._moved = run_dir.hold(), ""
        self._saved_iteration = -1
        self._said = False
        self._stop_request = StopRequest(progress)

    def run(self, teacher: Policy | None = None) -> RunResult:
        """Run :meth:`train` and return its result."""
        return self._result(*self.train(teacher))

    def train(self, teacher: Policy | None = None) -> tuple[Status, EvaluationResult | None]:
        """Train until the budget is used up or a stop is requested; always leave a checkpoint.

        Args:
            teacher: policy that the adversary is made to act like first.
        """
        trainer, hooks = self.trainer, self.trainer.attack.hooks
        self.progress.started(self.config, self.run_dir.path, self.victim, trainer.steps)
        for note in (*hooks.notes(), *self._costly_scores()) if self.world.is_main else ():
            self.progress.note(note)
        try:
            with hooks.attribution(), in_contact(), self._stop_request.listening(), one_torch_thread():
                with hooks.arguments_unchanged():  # for the start only: it copies the arguments
                    self._hook.run_started(run=trainer)
                if teacher is not None:
                    self._warm_start(teacher)
                with hooks.arguments_unchanged():
                    if self._goes_on:
                        self._iteration()
                states_of(hooks.of(RunPlugin))  # state that grows in training must be storable as well
                while self._goes_on:
                    self._iteration()
                self.save()
                status, evaluation = self._finish()
        except failures() as error:
            self._note_failure(error)
            raise
        finally:
            self._close()
        return status, evaluation

    def _warm_start(self, teacher: Policy) -> None:
        self.progress.note(f"cloning {teacher.info.name} in the first {self.config.init_steps:,} steps")
        warm_start(self.trainer, teacher)
        self.save()
        with suppress(Stopped):
            self.progress.note(beside_teacher(self.trainer, teacher, self._stop_request.progress))

    def _costly_scores(self) -> Iterator[str]:
        """A warning if evaluation may take longer than the remaining training."""
        trainer, wanted = self.trainer, self.config.evaluation
        left, longest = trainer.total_steps - trainer.steps, trainer.layout.max_steps
        on_the_way = left // wanted.every_steps * wanted.periodic_episodes if wanted.every_steps else 0
        steps = (wanted.episodes + on_the_way) * longest
        if steps > left:
            yield (
                f"scores may cost more than the training: {wanted.episodes + on_the_way:,} games of up to "
                f"{longest:,} steps, for {left:,} steps of training (evaluation.episodes, "
                "evaluation.every_steps)"
            )

    def _say_how_long(self, metrics: dict[str, float]) -> None:
        """After a session's first iteration, note the remaining time if it is hours."""
        speed = metrics["steps_per_second"]
        seconds = (metrics["total_steps"] - metrics["steps"]) / speed
        if seconds > _LONG:
            self.progress.note(
                f"about {seconds / 3600:.1f} hours to go at {speed:,.0f} steps/s; Ctrl-C leaves a "
                f"checkpoint, and {self.world.command} resume {self.run_dir.path} goes on"
            )

    @property
    def _hook(self) -> Any:
        """Caller of run hooks: plugin modules, which may print and write, are called in one process only.

        Stateful plugins are called in every process, so that their states stay equal.
        """
        hooks = self.trainer.attack.hooks
        if self.world.is_main:
            return hooks.hook
        stateful = hooks.of(RunPlugin)
        return hooks.without([plugin for name, plugin in hooks.plugins.items() if name not in stateful])

    @property
    def _goes_on(self) -> bool:
        trainer = self.trainer
        if self.world.size > 1:  # all stop if one has a reason; the first reason is reported
            reasons = [reason for reason in self.world.gather(trainer.stopped) if reason]
            trainer.stopped = reasons[0] if reasons else ""
        return not (trainer.finished or trainer.stopped or self.world.any(self._stop_request.asked))

    def _iteration(self) -> None:
        trainer = self.trainer
        if self.world.is_main:
            self._follow()
        if self._moved:
            if self.world.size == 1:
                self.save()
            raise RunDirError(self._moved)
        before = trainer.steps
        metrics = trainer.iterate()
        if self.world.is_main:
            every = self.config.evaluation.every_steps
            if every and before // every < trainer.steps // every:
                # where this fails, a resumed run repeats the iteration and has its score
                metrics.update(self._evaluate_on_the_way())
            self._report_or_save(before, metrics)
        if self.world.size > 1:  # the others wait here while the first one evaluates
            metrics = self.world.share(metrics)
        if not self.world.is_main:
            self._hook.iteration_finished(run=trainer, metrics=metrics)
        if trainer.iteration % self.config.checkpoint.every_iterations == 0:
            self.save()

    def _report_or_save(self, before: int, metrics: dict[str, float]) -> None:
        """Call :meth:`_report`; if it fails, save the finished iteration first."""
        try:
            self._report(before, metrics)
        except failures() as error:
            if self.world.size == 1:  # else saving would wait for processes that wait here
                with suppress(ApilError):
                    self.save()
            if self._moved:
                raise RunDirError(self._moved) from error
            raise

    def _follow(self) -> None:
        """Find the run's directory if it was moved, or make it again if it was deleted, and remember that."""
        before, self.run_dir = self.run_dir, self.run_dir.found(self._held)
        if before is self.run_dir:
            return
        moved = os.path.samestat(os.fstat(self._held.descriptor), self.run_dir.path.stat())
        os.close(self._held.descriptor)
        self._held, self._saved_iteration = self.run_dir.hold(), -1
        what = f"moved to {self.run_dir.path}" if moved else "deleted with its log and checkpoints"
        where = f"{self.world.command} resume {self.run_dir.path}"
        self._moved = (
            f"{before.path} was {what} during training; from iteration {self.trainer.iteration}: {where}"
        )

    def _report(self, before: int, metrics: dict[str, float]) -> None:
        """Report the iteration to recorders, progress and hooks, and keep the best so far."""
        trainer = self.trainer
        metrics["memory_mb"] = resident_mb()
        self.log.record(metrics, trainer.steps - before)
        self.progress.iteration(metrics)
        if not self._said:
            self._say_how_long(metrics)
            self._said = True
        trainer.hook.iteration_finished(run=trainer, metrics=metrics)
        if self.history.is_best(trainer.steps):
            self._follow()
            if self.world.size == 1:
                self.save()  # a kill before the next checkpoint would cost this best and the last one
            checkpoint.save(self.run_dir.best_path, self._state())

    def save(self) -> None:
        """Write a checkpoint of this iteration boundary (once) and drop the oldest.

        The first process's file is written last, so where it is, there are all.
        """
        iteration = self.trainer.iteration
        if self._saved_iteration == iteration:
            return
        state = self._state()
        if self.world.is_main:
            self._follow()
        path = self.run_dir.checkpoint_path(iteration)
        if not self.world.is_main:
            checkpoint.save(part_of_rank(path, self.world.rank), state)
        self.world.wait()
        if self.world.is_main:
            path.parent.mkdir(exist_ok=True)
            checkpoint.save(path, state)
            self.run_dir.prune(self.config.checkpoint.keep)
        self._saved_iteration = iteration

    def _state(self) -> dict[str, Any]:
        return {
            **self.trainer.state_dict(),
            "pending_rows": self.log.pending,
            "evaluations": self.history.rows,
            "stopped": self.trainer.stopped,
        }

    def _evaluate_on_the_way(self) -> dict[str, float]:
        """Score the adversary on separate games; stop if a stopping condition holds.

        Not interrupted by Ctrl-C: a resumed run would lack the score.
        """
        trainer, wanted = self.trainer, self.config.evaluation
        # the final score must not use the games by which the best was selected
        seed = stream_seed(self.config.seed, "evaluation during training")
        result = self._score(wanted.periodic_episodes, self.progress, seed=seed)
        self.history.add(result, trainer.steps)
        if reason := self.history.why_stop(wanted.stop_when):
            trainer.stop(reason)
        return _evaluation_metrics(result)

    def _finish(self) -> tuple[Status, EvaluationResult | None]:
        """Score at the end unless interrupted; the other processes wait for the first one's score."""
        status: Status = "interrupted"
        evaluation = None
        over = self.trainer.finished or self.trainer.stopped
        if self.trainer.stopped and self.world.is_main:
            self.progress.note(f"stopped early: {self.trainer.stopped}")
        if self.world.is_main and over and not self._stop_request.asked:
            with suppress(Stopped):  # the checkpoint is written already
                evaluation = self._final_evaluation()
                status = "finished"
            self._follow()  # the score is written where the directory is now
            if self._moved:
                self.progress.note(self._moved)
        if evaluation is not None:
            scores = _evaluation_metrics(evaluation, "final")
            self.log.summarize({"final/steps": self.trainer.steps, **scores})
        status = self.world.share(status)
        if status == "finished":
            self._hook.run_finished(run=self.trainer)
        return status, evaluation

    def _note_failure(self, error: BaseException) -> None:
        if not self.world.is_main:
            return
        newest, command = self.run_dir.checkpoints(), f"{self.world.command} resume {self.run_dir.path}"
        where = f"; continue from the last checkpoint with: {command}" if newest else ""
        message = f"stopped after {self.trainer.iteration} whole iterations by an error{where}"
        self.progress.note(message)
        with suppress(ApilError):
            self.run_dir.write_json(
                self.run_dir.result_path,
                {"status": "failed", "steps": self.trainer.steps, "error": str(error)},
            )

    def _score(self, episodes: int, progress: Progress, **options: Any) -> EvaluationResult:
        result = score_in_training(self.trainer, episodes, progress, **options)
        self.progress.evaluation(result, self.trainer.steps)
        return result

    def _final_evaluation(self) -> EvaluationResult | None:
        episodes = self.config.evaluation.episodes
        if not episodes:
            return None
        path = self.run_dir.checkpoint_path(self.trainer.iteration)
        name = f"run:{self.run_dir.path}"
        return self._score(episodes, self._stop_request.progress, name=name, sha256=sha256(path))

    def _result(self, status: Status, evaluation: EvaluationResult | None) -> RunResult:
        result = RunResult(
            run_dir=self.run_dir.path,
            status=status,
            steps=self.trainer.steps,
            wall_seconds=self.trainer.wall_seconds,
            stopped=self.trainer.stopped,
            best=self.history.best,
            evaluation=evaluation,
            white_box=self.trainer.attack.hooks.white_box,
        )
        if self.world.is_main:
            self.run_dir.write_json(self.run_dir.result_path, result.model_dump(mode="json"))
        return result

    def _close(self) -> None:
        os.close(self._held.descriptor)
        self.log.close()
        self.progress.finished(self.run_dir.path)
        self.trainer.close()


def _evaluation_metrics(result: EvaluationResult, prefix: str = "evaluation") -> dict[str, float]:
    rates: dict[str, Any] = {
        "win": result.win_rate,
        "tie": result.tie_rate,
        "loss": result.loss_rate,
        "win_or_tie": result.win_or_tie_rate,
    }
    metrics: dict[str, float] = {f"{prefix}/episodes": result.episodes}
    for name, rate in rates.items():
        metrics[f"{prefix}/{name}"] = rate.value
        metrics[f"{prefix}/{name}_low"] = rate.low
        metrics[f"{prefix}/{name}_high"] = rate.high
    return metrics
