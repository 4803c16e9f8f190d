"""One session of a retraining: a run's session that stores the victim and scores each opponent."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Literal

import torch
from pydantic import BaseModel

from apil_core.common.documents import EXACT
from apil_core.evaluation.progress import Progress
from apil_core.evaluation.results import EvaluationResult, PolicyId
from apil_core.evaluation.score import evaluate
from apil_core.plugins.discovery import PluginRegistry
from apil_core.policies.student import load_file, save_policy
from apil_core.runs.retraining.folder import RetrainDir, name_of
from apil_core.runs.retraining.trainer import RetrainTrainer
from apil_core.runs.session import Session
from apil_core.runs.stop_signal import Stopped
from apil_core.training.storage.environment import code_and_time

Scores = dict[str, EvaluationResult]


class RetrainResult(BaseModel):
    """The result of a retraining.

    Attributes:
        directory: where everything is.
        victim: as it was.
        hardened: as it is now.
        opponents: by label: each adversary's method, and ``baseline``.
        shares: of play, by label.
        before, after: scores of each opponent on its own against the victim as it was and as it is now, by
            label. As everywhere ``wins`` are the adversary's: the victim's are its ``losses``.
    """

    model_config = EXACT

    directory: Path
    status: Literal["finished", "interrupted", "failed"]
    env: str
    steps: int
    wall_seconds: float
    victim: PolicyId
    hardened: PolicyId
    opponents: dict[str, PolicyId]
    shares: dict[str, float]
    before: dict[str, EvaluationResult] = {}
    after: dict[str, EvaluationResult] = {}

    def __fspath__(self) -> str:
        """The directory: a result may stand wherever the hardened victim's name does."""
        return str(self.directory)


class RetrainSession(Session):
    """A retraining between start and finish, Ctrl-C or crash.

    Args:
        trainer: in memory.
        directory: where everything goes.
        progress: gets iterations, scores and notes.
        plugins: for recorders and evaluations.
        state: of the checkpoint it resumes from.
    """

    trainer: RetrainTrainer
    run_dir: RetrainDir

    def __init__(
        self,
        trainer: RetrainTrainer,
        directory: RetrainDir,
        progress: Progress,
        plugins: PluginRegistry,
        state: Mapping[str, Any] | None = None,
    ):
        state = state or {}
        super().__init__(trainer, directory, progress, plugins, state.get("pending_rows", ()))
        self.plugins = plugins
        self.retraining = trainer.retraining
        # for the headline: the victim and its opponents
        self.config = self.config.model_copy(update={"method": f"retraining {self.config.victim}"})
        parts = self.retraining.shares.items()
        self.victim = ", ".join(f"{label} {100 * share:.3g} %" for label, share in parts if share)
        before = state.get("before", {})
        self._before = {label: EvaluationResult.model_validate(score) for label, score in before.items()}
        self._after: Scores = {}

    def retrain(self) -> RetrainResult:
        """Train until the budget is used up or a stop is requested; always save a checkpoint and a victim."""
        status, _ = self.train()
        hardened = load_file(self.run_dir.victim_path, name_of(self.run_dir.path)).info
        result = RetrainResult(
            directory=self.run_dir.path,
            status=status,
            env=self.config.env,
            steps=self.trainer.steps,
            wall_seconds=self.trainer.wall_seconds,
            victim=PolicyId.of(self.trainer.original),
            hardened=PolicyId.of(hardened),
            opponents={label: PolicyId.of(info) for label, info in self.trainer.opponents.items()},
            shares=self.retraining.shares,
            before=self._before,
            after=self._after,
        )
        self.run_dir.write_json(self.run_dir.result_path, result.model_dump(mode="json"))
        return result

    def _iteration(self) -> None:
        evaluation = self.retraining.evaluation
        if evaluation.before and not self._before and not self.trainer.iteration:
            with suppress(Stopped):
                self._before = self._scores(
                    self.config.victim, evaluation.episodes, self._stop_request.progress
                )
            if self._stop_request.asked:
                return
            self.save()  # these scores, for a kill before the first checkpoint
        super()._iteration()

    def _evaluate_on_the_way(self) -> dict[str, float]:
        """Score the present victim, as counts."""
        self._write_victim()
        name, games = name_of(self.run_dir.path), self.config.evaluation.periodic_episodes
        return _counts(self._scores(name, games, self.progress), "evaluation")

    def _final_evaluation(self) -> None:
        name, games = name_of(self.run_dir.path), self.config.evaluation.episodes
        self._after = self._scores(name, games, self._stop_request.progress)
        self.log.summarize({"final/steps": self.trainer.steps, **_counts(self._after, "final")})

    def _scores(self, victim: str, episodes: int, progress: Progress) -> Scores:
        """By label, scores as of ``apil eval OPPONENT --victim VICTIM``: wins are the opponent's.

        The players are loaded separately, so no generator of the training is used.
        """
        config, found = self.retraining, {}
        for label, name in config.opponents.items() if episodes else ():
            with torch.random.fork_rng(devices=[]):
                found[label] = evaluate(
                    name,
                    episodes=episodes,
                    seed=config.seed,
                    progress=progress,
                    env=config.env,
                    victim=victim,
                    adversary_actions=config.evaluation.adversary_actions,
                    victim_actions=config.evaluation.victim_actions,
                    game_options=config.game,
                    threads=config.threads,
                    device=config.device,
                    plugins=self.plugins,
                    trust=config.trust,
                    victim_seat=config.victim_side,
                )
        for label, score in found.items():
            self.progress.note(f"{label} against the victim:")
            self.progress.evaluation(score, self.trainer.steps)
        return found

    def save(self) -> None:
        """Write the victim and a checkpoint of this iteration boundary (once), and drop the oldest."""
        if self._saved_iteration != self.trainer.iteration:
            self._write_victim()
        super().save()

    def _state(self) -> dict[str, Any]:
        before = {label: score.model_dump(mode="json") for label, score in self._before.items()}
        return {**super()._state(), "before": before}

    def _write_victim(self) -> None:
        config = self.retraining
        provenance = {
            "victim": config.victim,
            "victim_sha256": config.victim_sha256,
            "env": config.env,
            "opponents": self.victim,
            **{f"{label}_sha256": info.sha256 for label, info in self.trainer.opponents.items()},
            "steps": self.trainer.steps,
            "seed": config.seed,
            **code_and_time(),
        }
        shape, weights = self.trainer.hardened()
        save_policy(self.run_dir.victim_path, shape, weights, provenance)


def _counts(scores: Scores, prefix: str) -> dict[str, float]:
    """Games, and the victim's wins and ties among them, by label."""
    counts: dict[str, float] = {}
    for label, score in scores.items():
        each = {"games": score.episodes, "wins": score.losses, "ties": score.ties}
        counts |= {f"{prefix}/{label}/{key}": count for key, count in each.items()}
    return counts
