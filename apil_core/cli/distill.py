"""``apil distill``."""

from __future__ import annotations

import sys
from dataclasses import field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Group, Parameter

from apil_core.cli.flags import Flags, Json, Plugins, Quiet, flags_of, setting_flag
from apil_core.cli.output import console, emit, table
from apil_core.cli.progress import make_progress
from apil_core.cli.readout import percent
from apil_core.common.errors import ConfigError
from apil_core.runs.distillation.config import DistillConfig

if TYPE_CHECKING:
    from apil_core.common.statistics import Difference
    from apil_core.evaluation.progress import Progress
    from apil_core.plugins.discovery import PluginRegistry
    from apil_core.runs.distillation.report import Report
    from apil_core.runs.distillation.trainer import Entry

_WHO = Group("Who learns from whom", sort_key=0)
_HOW = Group("How", sort_key=1)


@flags_of(
    DistillConfig,
    {
        _WHO: ("env", "role", "teacher", "opponent"),
        _HOW: (
            *("game.physics", "network", "width", "steps", "num_envs", "episodes"),
            *("seed", "threads", "device"),
        ),
    },
    {
        "env": "Game.",
        "teacher": "Policy to imitate [default: the game's agent for this side].",
        "opponent": "Policy it plays against [default: the game's agent for the other side].",
        "game.physics": "[default: faithful]",
        "network": "Student's network [default: lstm for a recurrent teacher, else mlp].",
        "steps": "Game steps to play and label, rounded up to whole blocks.",
        "episodes": "Games of each final score; 0: none.",
    },
)
class DistillFlags(Flags):
    """The settings of a distillation; omitted ones have the defaults of :class:`DistillConfig`."""

    sets: Annotated[
        list[str],
        setting_flag("Any other setting, e.g. final_passes=40 or game.max_steps=100; repeatable.", _HOW),
    ] = field(default_factory=list)


def distill(
    *,
    flags: DistillFlags | None = None,
    out: Annotated[
        Path | None, Parameter(help="Directory for everything [default: runs/ENV/distill/ROLE-sSEED].")
    ] = None,
    resume: Annotated[
        Path | None, Parameter(help="Go on with the distillation in this directory; takes no other setting.")
    ] = None,
    plugin: Plugins | None = None,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Train a compact student of a policy: it acts, its teacher says what it would have done (DAgger).

    The student learns the teacher's mean action and copies its standard deviation. It is left in
    DIR/student.safetensors; use it as safetensors:DIR/student.safetensors. Resume an
    interrupted distillation with --resume DIR.
    """
    from apil_core.plugins.discovery import discover
    from apil_core.runs.distillation.distill import distill as start
    from apil_core.runs.distillation.distill import resume_distillation

    flags = flags or DistillFlags()
    registry = discover(plugin or [])
    with make_progress(quiet=quiet) as progress:
        tell = _teller(progress)
        if resume is not None:
            if flags != DistillFlags() or out is not None:
                raise ConfigError("--resume takes its settings from the directory; leave out the others")
            report = resume_distillation(resume, progress=progress, on_stage=tell, plugins=registry)
            where = resume
        else:
            config = _config(flags, registry)
            where = out or Path("runs") / config.env / "distill" / f"{config.role}-s{config.seed}"
            command = ["apil", *sys.argv[1:]]
            report = start(
                config, out=where, progress=progress, on_stage=tell, command=command, plugins=registry
            )
    emit(report, as_json, lambda: _print_report(report, where))


def _config(flags: DistillFlags, plugins: PluginRegistry) -> DistillConfig:
    from apil_core.runs.distillation.config import settings

    given = flags.given()
    if not {"env", "role"} <= given.keys():
        raise ConfigError("say what to distill: --env GAME --role SIDE (or --resume DIR)")
    return settings(given, flags.sets, plugins)


def _teller(progress: Progress) -> Any:
    def tell(entry: Entry, stages: int) -> None:
        fresh = "" if entry.fresh_error is None else f", on its own states {entry.fresh_error**0.5:.3f}"
        progress.note(
            f"stage {entry.stage} of {stages}: {entry.steps:,} steps, "
            f"error {entry.error**0.5:.3f} of the teacher's σ{fresh}"
        )

    return tell


def _print_report(report: Report, where: Path) -> None:
    out = console()
    out.print(f"{report.teacher} → {where / 'student.safetensors'}", style="bold")
    rows = table("student's action error", "rms, σ>", "best constant>", "KL, nats per step>")
    for name, error in (
        ("against the opponent", report.action_error),
        ("against it, perturbed", report.perturbed_action_error),
    ):
        figures = (error.rms_sigma, error.constant_rms_sigma, error.kl_nats)
        rows.add_row(name, *(f"{figure:.3f}" for figure in figures))
    out.print(rows)
    if report.student_score is None or report.teacher_score is None:
        return
    scores = table(f"against {report.opponent}", "games>", "win>", "tie>", "loss>", "win or tie>")
    for who, score in (("student", report.student_score), ("teacher", report.teacher_score)):
        rates = (score.win_rate, score.tie_rate, score.loss_rate, score.win_or_tie_rate)
        scores.add_row(who, str(score.episodes), *(percent(rate) for rate in rates))
    out.print(scores)
    for name, gap in (("win", report.win_difference), ("win or tie", report.win_or_tie_difference)):
        if gap is not None:
            out.print(f"student minus teacher, {name}: {_points(gap)}")


def _points(gap: Difference) -> str:
    noise = ", within noise" if gap.within_noise else ""
    return f"{100 * gap.value:+.1f} points [{100 * gap.low:+.1f}, {100 * gap.high:+.1f}]{noise}"
