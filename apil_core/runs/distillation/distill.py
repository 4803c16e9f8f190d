"""Distil a student, from the settings to the report; resumable from the last stage after any interruption."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import torch

from apil_core.common.torch_threads import one_torch_thread
from apil_core.evaluation.progress import Progress
from apil_core.evaluation.results import EvaluationResult
from apil_core.plugins.defined import as_text
from apil_core.plugins.discovery import PluginRegistry
from apil_core.plugins.registry import default_plugins
from apil_core.policies.frozen_policy import FrozenPolicy
from apil_core.policies.student import load_file, save_policy, weights_sha256
from apil_core.runs.distillation.build import named, prepare
from apil_core.runs.distillation.config import DistillConfig, settings
from apil_core.runs.distillation.distill_dir import DistillDir
from apil_core.runs.distillation.report import Report, make_report, scores_of
from apil_core.runs.distillation.trainer import DistillTrainer, Entry
from apil_core.training.storage import checkpoint
from apil_core.training.storage.environment import code_and_time

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
    with closing(prepare(named(config, registry), registry)) as trainer:
        directory = DistillDir.begin(Path(out), trainer.config, command)
        with directory.lock():
            return _go(trainer, directory, progress or Progress(), on_stage, registry)


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
    config, registry = directory.settings(), plugins or default_plugins()
    with directory.lock(), closing(prepare(config, registry)) as trainer:
        if directory.checkpoints():
            state = checkpoint.read(directory.newest_checkpoint())
            played = range(min(len(state["log"]), trainer.rounds))
            blocks = [directory.load_block(number, trainer.log_std.device) for number in played]
            trainer.load_state_dict(state, blocks)
        return _go(trainer, directory, progress or Progress(), on_stage, registry)


def _go(
    trainer: DistillTrainer,
    directory: DistillDir,
    progress: Progress,
    on_stage: OnStage | None,
    plugins: PluginRegistry,
) -> Report:
    with one_torch_thread():
        while trainer.done < trainer.stages:
            entry = trainer.advance()
            if entry.stage <= trainer.rounds:  # first the block, then the state that counts it
                directory.save_block(entry.stage - 1, trainer.blocks[-1])
            checkpoint.save(directory.checkpoint_path(entry.stage), trainer.state_dict())
            directory.prune(1)
            if on_stage is not None:
                on_stage(entry, trainer.stages)
        student = _write_student(trainer, directory, {})
        report = make_report(trainer, student, scores_of(trainer, student, progress, plugins))
    _write_student(trainer, directory, _figures(report))
    directory.write_json(directory.report_path, report.model_dump(mode="json"))
    directory.drop_blocks()
    return report


def _write_student(trainer: DistillTrainer, directory: DistillDir, more: dict[str, Any]) -> FrozenPolicy:
    """Write the student's file and read it back, so that the scored student is the stored one."""
    weights = trainer.weights()
    config, teacher = trainer.config, trainer.teacher.info
    provenance = {
        "teacher": teacher.name,
        "teacher_sha256": teacher.sha256,
        "opponent": trainer.opponent.info.name,
        "env": config.env,
        "role": config.role,
        "steps": trainer.steps,
        "network": f"{config.network} {config.width if config.network != 'mlp' else ''}".strip(),
        "seed": config.seed,
        **code_and_time(),
        **more,
    }
    save_policy(directory.student_path, trainer.shape, weights, provenance)
    name = f"student:{weights_sha256(weights)[:12]} of {teacher.name}"
    return load_file(directory.student_path, name).to(torch.device(config.device))


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
