"""Comparison of a student with its teacher: action error on the student's own states, and scores."""

from __future__ import annotations

from contextlib import closing
from typing import Any

import torch
from pydantic import BaseModel

from apil_core.api.config import RunConfig
from apil_core.api.policy import Policy
from apil_core.common.statistics import Difference
from apil_core.evaluation.pairing import Pairing
from apil_core.evaluation.progress import Progress
from apil_core.evaluation.results import EvaluationResult, gap
from apil_core.evaluation.score import parallel_games, score
from apil_core.plugins.discovery import PluginRegistry
from apil_core.runs.distillation.collector import Roles
from apil_core.runs.distillation.learner import kl_nats
from apil_core.runs.distillation.trainer import DistillTrainer


class ActionError(BaseModel):
    """Distance of the student's mean action from its teacher's, in games not used for training.

    Attributes:
        steps: labelled steps it was measured on.
        rms_sigma: root mean square of the difference, in the teacher's standard deviations.
        constant_rms_sigma: the same for the best constant action, fitted to these very steps.
        kl_nats: KL(teacher ‖ student) per step, summed over action components.
    """

    steps: int
    rms_sigma: float
    constant_rms_sigma: float
    kl_nats: float


class Report(BaseModel):
    """The result of a distillation. Scores are from the student's seat, with a run's default action modes."""

    student: str
    teacher: str
    opponent: str
    env: str
    role: str
    steps: int
    action_error: ActionError
    perturbed_action_error: ActionError
    student_score: EvaluationResult | None = None
    teacher_score: EvaluationResult | None = None
    win_difference: Difference | None = None
    win_or_tie_difference: Difference | None = None


def action_error(trainer: DistillTrainer, student: Policy, *, perturbed: bool) -> ActionError:
    """Play separate games, the student acting (sampled), against the plain or the perturbed opponent."""
    sigma = trainer.log_std.exp()
    everywhere = torch.ones(trainer.config.num_envs, dtype=torch.bool, device=sigma.device)
    roles = Roles(~everywhere, everywhere, everywhere if perturbed else ~everywhere)
    name = f"held out, perturbed {perturbed}"
    block, mean = trainer.collector.play(name, trainer.side, trainer.block_steps, roles, student)
    label, miss = ((part / sigma).flatten(0, 1) for part in (block.label, mean - block.label))
    squared = float(miss.square().mean())
    constant = float((label - label.mean(0)).square().mean())
    return ActionError(
        steps=len(label),
        rms_sigma=squared**0.5,
        constant_rms_sigma=constant**0.5,
        kl_nats=kl_nats(squared, label.shape[1]),
    )


def scores_of(
    trainer: DistillTrainer, student: Policy, progress: Progress, plugins: PluginRegistry
) -> dict[str, EvaluationResult]:
    """Score student and teacher on the same games."""
    config = trainer.config
    if not config.episodes:
        return {}
    run = RunConfig(env=config.env, game=config.game, device=config.device, threads=config.threads)
    with closing(parallel_games(run, config.episodes, plugins)) as game:
        return {
            who: score(
                Pairing(run, game, policy, trainer.opponent, trainer.side),
                episodes=config.episodes,
                seed=config.seed,
                progress=progress,
            )
            for who, policy in (("student_score", student), ("teacher_score", trainer.teacher))
        }


def make_report(trainer: DistillTrainer, student: Policy, scores: dict[str, Any]) -> Report:
    """Measure the action errors and combine them with the scores.

    Args:
        trainer: its game is played on.
        student: the finished one.
        scores: ``student_score`` and ``teacher_score``, or nothing.
    """
    config, found = trainer.config, dict(scores)
    if scores:
        for name, ties in (("win_difference", False), ("win_or_tie_difference", True)):
            found[name] = gap(scores["student_score"], scores["teacher_score"], ties=ties)
    return Report(
        student=student.info.sha256,
        teacher=config.teacher,
        opponent=config.opponent,
        env=config.env,
        role=config.role,
        steps=trainer.steps,
        action_error=action_error(trainer, student, perturbed=False),
        perturbed_action_error=action_error(trainer, student, perturbed=True),
        **found,
    )
