"""Comparison of a student with its teacher: action error on the student's own states, and scores."""

from __future__ import annotations

from typing import Any

import torch
from pydantic import BaseModel
from torch import Tensor

from apil_core.api.config import RunConfig
from apil_core.api.game import Game
from apil_core.api.policy import Policy
from apil_core.api.types import View
from apil_core.common.statistics import Difference, difference
from apil_core.evaluation.pairing import Pairing
from apil_core.evaluation.progress import Progress
from apil_core.evaluation.results import EvaluationResult
from apil_core.evaluation.score import score
from apil_core.runs.distillation.build import Setting
from apil_core.runs.distillation.collector import Roles, Sample
from apil_core.runs.distillation.learner import kl_nats


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


def action_error(setting: Setting, student: Policy, *, perturbed: bool) -> ActionError:
    """Play separate games, the student acting (sampled), against the plain or the perturbed opponent."""
    course, sigma = setting.course, setting.course.log_std.exp()
    n, device = setting.game.num_envs, sigma.device
    everywhere = torch.ones(n, dtype=torch.bool, device=device)
    roles = Roles(~everywhere, everywhere, everywhere if perturbed else ~everywhere)
    labels: list[Tensor] = []
    misses: list[Tensor] = []
    first = everywhere

    def act(observation: Tensor, label: Tensor) -> Tensor:
        mean = student.act(View(observation, observation, first), sample=False).action
        labels.append(label / sigma)
        misses.append((mean - label) / sigma)
        return mean

    def take(sample: Sample) -> None:
        nonlocal first
        first = sample.done

    name = f"held out, perturbed {perturbed}"
    course.collector.play(name, setting.side, course.block_steps, roles, act, take)
    label, miss = torch.cat(labels), torch.cat(misses)
    squared = float(miss.square().mean())
    constant = float((label - label.mean(0)).square().mean())
    return ActionError(
        steps=len(label),
        rms_sigma=squared**0.5,
        constant_rms_sigma=constant**0.5,
        kl_nats=kl_nats(squared, label.shape[1]),
    )


def compare(student: EvaluationResult, teacher: EvaluationResult) -> dict[str, Difference]:
    """Student minus teacher, with Newcombe's 95 % intervals."""
    games = student.episodes, teacher.episodes
    wins = student.wins, teacher.wins
    unlost = student.wins + student.ties, teacher.wins + teacher.ties
    return {
        "win_difference": difference(wins[0], games[0], wins[1], games[1]),
        "win_or_tie_difference": difference(unlost[0], games[0], unlost[1], games[1]),
    }


def score_of(policy: Policy, setting: Setting, game: Game, progress: Progress) -> EvaluationResult:
    """Score a policy in the student's seat against the opponent."""
    config = setting.config
    run = RunConfig(env=config.env, game=config.game, device=config.device)
    pairing = Pairing(run, game, policy, setting.opponent, setting.side)
    return score(pairing, episodes=config.episodes, seed=config.seed, progress=progress)


def make_report(setting: Setting, student: Policy, scores: dict[str, Any]) -> Report:
    """Measure the action errors and combine them with the scores.

    Args:
        setting: its game is played on.
        student: the finished one.
        scores: ``student_score`` and ``teacher_score``, or nothing.
    """
    config = setting.config
    differences: dict[str, Any] = {}
    if scores:
        differences.update(compare(scores["student_score"], scores["teacher_score"]))
    return Report(
        student=student.info.sha256,
        teacher=config.teacher,
        opponent=config.opponent,
        env=config.env,
        role=config.role,
        steps=setting.course.steps,
        action_error=action_error(setting, student, perturbed=False),
        perturbed_action_error=action_error(setting, student, perturbed=True),
        **scores,
        **differences,
    )
