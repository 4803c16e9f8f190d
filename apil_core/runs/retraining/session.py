"""One stretch of a retraining: iterations, checkpoints, recorders, Ctrl-C, and the scores at both ends."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from typing import Any, Literal

from apil_core.api.config import RunConfig
from apil_core.common.errors import FAILURES, ApilError
from apil_core.common.machine import resident_mb
from apil_core.common.torch_threads import one_torch_thread
from apil_core.evaluation.progress import Progress
from apil_core.evaluation.results import EvaluationResult, PolicyId
from apil_core.plugins.discovery import PluginRegistry
from apil_core.policies.student import load_file, save_file
from apil_core.runs.retraining.build import Setting, shares
from apil_core.runs.retraining.folder import RetrainDir, name_of
from apil_core.runs.retraining.scoring import RetrainResult, score_each
from apil_core.runs.stop_signal import Stopped, StopWish
from apil_core.training.storage import checkpoint
from apil_core.training.storage.metrics_log import RowLog, open_recorders
from apil_core.training.storage.run_dir import environment

Scores = dict[str, EvaluationResult]


class RetrainCourse:
    """A retraining between start and finish, Ctrl-C or crash.

    Args:
        setting: the parts.
        directory: where everything goes.
        progress: told how it goes.
        plugins: for recorders and evaluations.
        before: scores of the victim as it was, from a checkpoint.
    """

    def __init__(
        self,
        setting: Setting,
        directory: RetrainDir,
        progress: Progress,
        plugins: PluginRegistry,
        before: Mapping[str, Any] | None = None,
    ):
        self.setting = setting
        self.config = setting.config
        self.trainer = setting.trainer
        self.directory = directory
        self.files = directory.files
        self.progress = progress
        self.plugins = plugins
        self._before = {label: EvaluationResult.model_validate(v) for label, v in (before or {}).items()}
        recorders = open_recorders(
            [plugins.recorders[name] for name in self.config.recorders], directory.path
        )
        self.log = RowLog(recorders, 1, note=progress.note)
        self._saved_iteration = -1
        self._wish = StopWish(progress)

    def go(self) -> RetrainResult:
        """Train until the budget is used up or somebody stops it; always leaves a checkpoint and a victim."""
        self.progress.started(self._headline(), self.directory.path, self._against(), self.trainer.steps)
        status: Literal["finished", "interrupted"] = "interrupted"
        after: Scores = {}
        try:
            with self._wish.listening(), one_torch_thread():
                with suppress(Stopped):
                    self._score_before()
                while not self.trainer.finished and not self._wish.asked:
                    self._iteration()
                self.save()
                if not self._wish.asked:
                    with suppress(Stopped):
                        after = self._scores(name_of(self.directory.path), self.config.evaluation.episodes)
                        status = "finished"
                        self.log.summarize({"final/steps": self.trainer.steps, **_counts(after, "final")})
        except FAILURES as error:
            self._note_failure(error)
            raise
        finally:
            self._close()
        result = self._result(status, after)
        self.files.write_json(self.files.result_path, result.model_dump(mode="json"))
        return result

    def _headline(self) -> RunConfig:
        """What the progress display knows how to announce."""
        c = self.config
        return RunConfig(
            method=f"retraining {c.victim}",
            env=c.env,
            steps=c.steps,
            num_envs=c.num_envs,
            seed=c.seed,
            ppo=c.ppo,
        )

    def _against(self) -> str:
        parts = shares(self.config).items()
        return ", ".join(f"{label} {100 * share:.3g} %" for label, share in parts if share)

    def _score_before(self) -> None:
        evaluation = self.config.evaluation
        if evaluation.before and evaluation.episodes and not self._before and not self.trainer.iteration:
            self._before = self._scores(self.config.victim, evaluation.episodes)

    def _iteration(self) -> None:
        trainer = self.trainer
        steps = trainer.steps
        metrics = trainer.iterate()
        metrics["memory_mb"] = resident_mb()
        every = self.config.evaluation.every_steps
        if every and steps // every < trainer.steps // every:
            metrics |= self._periodic()
        self.log.record(metrics, trainer.steps - steps)
        self.progress.iteration(metrics)
        if trainer.iteration % self.config.checkpoint.every_iterations == 0:
            self.save()

    def _periodic(self) -> dict[str, float]:
        """Scores of the present victim, as counts.

        Not broken off by Ctrl-C: a retraining that is gone on with would have missed it.
        """
        self._write_victim()
        games = self.config.evaluation.periodic_episodes
        found = self._scores(name_of(self.directory.path), games, self.progress)
        return _counts(found, "evaluation")

    def _scores(self, victim: str, episodes: int, progress: Progress | None = None) -> Scores:
        if not episodes:
            return {}
        found = score_each(self.config, victim, episodes, progress or self._wish.progress, self.plugins)
        for label, score in found.items():
            self.progress.note(f"{label} against the victim:")
            self.progress.evaluation(score, self.trainer.steps)
        return found

    def save(self) -> None:
        """Write the victim and a checkpoint of this iteration boundary (once), and drop the oldest."""
        iteration = self.trainer.iteration
        if self._saved_iteration == iteration:
            return
        self._write_victim()
        before = {label: score.model_dump(mode="json") for label, score in self._before.items()}
        path = self.files.checkpoint_path(iteration)
        checkpoint.save(path, {**self.trainer.state_dict(), "before": before, "pending_rows": []})
        self.files.prune(self.config.checkpoint.keep)
        self._saved_iteration = iteration

    def _write_victim(self) -> None:
        network, config = self.trainer.learner.network, self.config
        made = environment(())
        provenance = {
            "victim": config.victim,
            "victim_sha256": config.victim_sha256,
            "env": config.env,
            "opponents": self._against(),
            **{f"{label}_sha256": p.info.sha256 for label, p in self.setting.opponents.items()},
            "steps": self.trainer.steps,
            "seed": config.seed,
            "code": f"apil {made['versions']['apil']}, git {made['git'] or 'unknown'}",
            "time": made["time"],
        }
        save_file(self.directory.victim_path, network.shape, network.weights(), provenance)

    def _result(self, status: Literal["finished", "interrupted"], after: Scores) -> RetrainResult:
        name = name_of(self.directory.path)
        hardened = load_file(self.directory.victim_path, name).info  # as it is kept, not as it is held
        return RetrainResult(
            directory=self.directory.path,
            status=status,
            env=self.config.env,
            steps=self.trainer.steps,
            wall_seconds=self.trainer.wall_seconds,
            victim=PolicyId.of(self.setting.victim.info),
            hardened=PolicyId.of(hardened),
            opponents={label: PolicyId.of(p.info) for label, p in self.setting.opponents.items()},
            shares=shares(self.config),
            before=self._before,
            after=after,
        )

    def _note_failure(self, error: BaseException) -> None:
        where = f"; continue from the last checkpoint with: apil resume {self.directory.path}"
        found = where if self.files.checkpoints() else ""
        self.progress.note(f"stopped after {self.trainer.iteration} whole iterations by an error{found}")
        with suppress(ApilError):
            failed = {"status": "failed", "steps": self.trainer.steps, "error": str(error)}
            self.files.write_json(self.files.result_path, failed)

    def _close(self) -> None:
        self.log.close()
        self.progress.finished(self.directory.path)


def _counts(scores: Scores, prefix: str) -> dict[str, float]:
    """Games, and the victim's wins and ties among them, by label."""
    counts: dict[str, float] = {}
    for label, score in scores.items():
        each = {"games": score.episodes, "wins": score.losses, "ties": score.ties}
        counts |= {f"{prefix}/{label}/{key}": count for key, count in each.items()}
    return counts
