"""Distil a student, from the settings to the report; resumable from the last stage after any interruption."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import torch

from apil_core.api.policy import Policy
from apil_core.common.errors import VictimError
from apil_core.common.torch_threads import one_torch_thread
from apil_core.evaluation.progress import Progress
from apil_core.evaluation.results import EvaluationResult
from apil_core.evaluation.score import MAX_PARALLEL_GAMES
from apil_core.plugins.defined import as_text
from apil_core.plugins.discovery import PluginRegistry
from apil_core.plugins.registry import default_plugins, make_game
from apil_core.policies.frozen_policy import FrozenPolicy
from apil_core.policies.network import Standardizer
from apil_core.policies.student import load_file, save_policy, weights_sha256
from apil_core.runs.distillation.build import Setting, named, prepare
from apil_core.runs.distillation.config import DistillConfig, settings
from apil_core.runs.distillation.distill_dir import DistillDir
from apil_core.runs.distillation.learner import Block
from apil_core.runs.distillation.report import Report, make_report, score_of
from apil_core.runs.distillation.trainer import Entry
from apil_core.training.storage import checkpoint
from apil_core.training.storage.environment import environment

OnStage = Callable[[Entry, int], None]


def distill(
    config: DistillConfig | None = None,
    *,
    out: Path | str,
    progress: Progress | None = None,
    on_stage: OnStage | None = None,
    command: Sequence[str] = (),
    plugins: PluginRegistry | None = None,
    **changes: Any,
) -> Report:
    """Train a compact student of a policy and score both against the same opponent.

    Args:
        config: the settings; default: of ``changes``.
        out: directory for everything; must not exist or be empty.
        progress: gets the number of games scored.
        on_stage: called after each stage with its log entry and the number of stages.
        command: stored for reproducibility.
        plugins: registry to use; default: the installed ones.
        changes: settings by key, as ``apil distill`` has them: ``env``, ``role``, ``teacher``, ``steps``, …

    Raises:
        ApilError: anything wrong in settings, weights or directory, before anything is played.
    """
    registry = plugins or default_plugins()
    config = config or settings({key: as_text(value) for key, value in changes.items()}, plugins=registry)
    setting = prepare(named(config, registry), registry)
    try:
        directory = DistillDir.begin(Path(out), setting.config, command)
        with directory.lock():
            return _go(setting, directory, progress or Progress(), on_stage, registry)
    finally:
        setting.close()


def resume_distillation(
    path: Path | str,
    *,
    progress: Progress | None = None,
    on_stage: OnStage | None = None,
    plugins: PluginRegistry | None = None,
) -> Report:
    """Resume a distillation exactly after its last whole stage.

    Raises:
        RunDirError: no distillation there, or one that cannot be continued.
        VictimError: the teacher's or the opponent's weights have changed since it began.
    """
    directory = DistillDir(path)
    if (finished := directory.report()) is not None:
        directory.drop_blocks()  # killed after the report was written
        return finished
    config = directory.settings()
    with directory.lock():
        registry = plugins or default_plugins()
        setting = prepare(config, registry)
        try:
            _restore(setting, directory)
            return _go(setting, directory, progress or Progress(), on_stage, registry)
        finally:
            setting.close()


def _go(
    setting: Setting,
    directory: DistillDir,
    progress: Progress,
    on_stage: OnStage | None,
    plugins: PluginRegistry,
) -> Report:
    course = setting.course
    with one_torch_thread():
        while course.done < course.stages:
            entry = course.advance()
            _keep(setting, directory)
            if on_stage is not None:
                on_stage(entry, course.stages)
        student = _student(setting, directory, {})
        scores = _scores(setting, student, progress, plugins)
        report = make_report(setting, student, scores)
    _student(setting, directory, _figures(report))
    directory.write_json(directory.report_path, report.model_dump(mode="json"))
    directory.drop_blocks()
    return report


def _keep(setting: Setting, directory: DistillDir) -> None:
    """Store a stage's result: a block if it played one, then the state that counts it."""
    course = setting.course
    if course.done == len(course.blocks):  # every stage so far played one
        directory.save_block(course.done - 1, course.blocks[-1].tensors())
    assert course.standardize is not None
    fixed = course.standardize
    checkpoint.save(
        directory.checkpoint_path(course.done),
        {
            "log": [asdict(entry) for entry in course.log],
            "standard": {"mean": fixed.mean, "std": fixed.std, "clip": fixed.clip},
            "learner": course.learner.state_dict(),
            "policies": {who: policy.info.sha256 for who, policy in _who(setting).items()},
        },
    )
    directory.prune(1)


def _who(setting: Setting) -> dict[str, Policy]:
    """Policies that must not change between sessions, by part."""
    return {"teacher": setting.teacher, "opponent": setting.opponent}


def _restore(setting: Setting, directory: DistillDir) -> None:
    if not directory.checkpoints():
        return
    state = checkpoint.read(directory.newest_checkpoint())
    for who, policy in _who(setting).items():
        expected = state["policies"][who]
        if policy.info.sha256 != expected:
            raise VictimError(
                f"the {who} {policy.info.name} has changed since the distillation began: "
                f"SHA-256 {policy.info.sha256}, expected {expected}"
            )
    course = setting.course
    course.log = [Entry(**entry) for entry in state["log"]]
    device = course.log_std.device
    fixed = state["standard"]
    course.standardize = Standardizer(fixed["mean"].to(device), fixed["std"].to(device), fixed["clip"])
    course.learner.load_state_dict(state["learner"])
    for number in range(min(course.done, course.rounds)):
        kept = {name: tensor.to(device) for name, tensor in directory.load_block(number).items()}
        course.blocks.append(Block(kept["observation"], kept["label"], kept["done"]))


def _student(setting: Setting, directory: DistillDir, more: dict[str, Any]) -> FrozenPolicy:
    """Write the student's file and read it back, so that the scored student is the stored one."""
    weights = setting.course.weights()
    made = environment(())
    config, teacher = setting.config, setting.teacher.info
    provenance = {
        "teacher": teacher.name,
        "teacher_sha256": teacher.sha256,
        "opponent": setting.opponent.info.name,
        "env": config.env,
        "role": config.role,
        "steps": setting.course.steps,
        "network": f"{config.network} {config.width if config.network != 'mlp' else ''}".strip(),
        "seed": config.seed,
        "code": f"apil {made['versions']['apil']}, git {made['git'] or 'unknown'}",
        "time": made["time"],
        **more,
    }
    save_policy(directory.student_path, setting.course.shape, weights, provenance)
    name = f"student:{weights_sha256(weights)[:12]} of {teacher.name}"
    student = load_file(directory.student_path, name)
    return student.to(torch.device(config.device))


def _scores(
    setting: Setting, student: FrozenPolicy, progress: Progress, plugins: PluginRegistry
) -> dict[str, EvaluationResult]:
    """Score both on the same games, as many in parallel as in ``apil eval``."""
    config = setting.config
    if not config.episodes:
        return {}
    game = make_game(
        config.env,
        num_envs=min(config.episodes, MAX_PARALLEL_GAMES),
        threads=config.threads,
        options=config.game,
        plugins=plugins,
    )
    try:
        return {
            "student_score": score_of(student, setting, game, progress),
            "teacher_score": score_of(setting.teacher, setting, game, progress),
        }
    finally:
        game.close()


def _figures(report: Report) -> dict[str, str]:
    """Format the report's figures for the file's provenance."""
    error = report.action_error
    found = {"action_error": f"rms {error.rms_sigma:.3f} sigma, {error.kl_nats:.3f} nats per step"}
    for who in ("student", "teacher"):
        result: EvaluationResult | None = getattr(report, f"{who}_score")
        if result is not None:
            found[f"{who}_score"] = (
                f"win {result.wins}, tie {result.ties}, loss {result.losses} of {result.episodes} games "
                f"against {report.opponent}, actions sampled"
            )
    return found
