"""``apil retrain``."""

from __future__ import annotations

import sys
from dataclasses import field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Group, Parameter

from apil_core.cli.finish import draw_curve
from apil_core.cli.flags import Flags, Json, Plugins, Quiet, flags_of, setting_flag
from apil_core.cli.guard import INTERRUPTED
from apil_core.cli.output import console, print_json, say, table
from apil_core.cli.progress import make_progress
from apil_core.cli.readout import percent
from apil_core.common.files import refuse_taken
from apil_core.runs.retraining.config import RetrainConfig

if TYPE_CHECKING:
    from apil_core.evaluation.results import EvaluationResult
    from apil_core.runs.retraining.session import RetrainResult

_WHO = Group("Who is hardened against whom", sort_key=0)
_HOW = Group("How", sort_key=1)


@flags_of(
    RetrainConfig,
    {
        _WHO: ("env", "victim", "baseline", "adversary_share", "mix"),
        _HOW: (
            *("game.physics", "steps", "num_envs", "critic", "freeze", "evaluation.episodes"),
            *("seed", "threads", "device"),
        ),
    },
    {
        "env": "Game [default: the runs'].",
        "victim": "Policy to harden [default: the one the runs attacked].",
        "game.physics": "[default: the first run's]",
        "evaluation.episodes": "Games of each score, before and after [default: 1000].",
    },
)
class RetrainFlags(Flags):
    """Flags for the settings of a retraining."""

    sets: Annotated[
        list[str],
        setting_flag(
            "Any other setting, e.g. ppo.learning_rate=1e-4 or evaluation.every_steps=500_000.", _HOW
        ),
    ] = field(default_factory=list)


def retrain(
    *adversaries: Annotated[
        str, Parameter(name="RUN", help="Runs whose adversaries the victim shall withstand.", required=True)
    ],
    flags: RetrainFlags | None = None,
    out: Annotated[
        Path | None, Parameter(help="Directory [default: runs/ENV/retrain/OPPONENTS/TIME-sSEED].")
    ] = None,
    plugin: Plugins | None = None,
    quiet: Quiet = False,
    as_json: Json = False,
) -> int:
    """Harden a victim: train it on, against a mixture of adversaries and the one it knows.

    The hardened victim plays anywhere as retrained:DIR. Ctrl-C writes a checkpoint; "apil resume DIR"
    resumes from it, bit for bit.
    """
    flags = flags or RetrainFlags()
    refuse_taken(out)

    from apil_core.runs.retraining.retrain import retrain as start
    from apil_core.runs.retraining.settings import settings

    config = settings(adversaries, flags.given(), flags.sets, plugin_files=plugin or ())
    with make_progress(quiet=quiet) as progress:
        result = start(config, out=out, progress=progress, command=["apil", *sys.argv[1:]])
    return finish(result, as_json=as_json)


def resume(
    directory: Path,
    *,
    steps: int | None,
    checkpoint: Path | None,
    threads: int | None,
    quiet: bool,
    as_json: bool,
) -> int:
    """``apil resume`` for the directory of a retraining."""
    from apil_core.runs.retraining.retrain import resume_retraining as go_on

    with make_progress(quiet=quiet) as progress:
        result = go_on(
            directory,
            steps=steps,
            checkpoint_path=checkpoint,
            threads=threads,
            progress=progress,
            command=["apil", *sys.argv[1:]],
        )
    return finish(result, as_json=as_json)


def finish(result: RetrainResult, *, as_json: bool) -> int:
    """Print how a retraining ended; return the exit code, 130 after Ctrl-C."""
    if as_json:
        print_json(result)
    elif result.status == "finished":
        print_result(result)
    if result.status == "finished":
        from apil_core.runs.retraining.folder import RetrainDir
        from apil_core.studies.curves.retraining import draw_opponents

        run = RetrainDir(result.directory)
        draw_curve(run.curve_path, lambda: draw_opponents(run, run.curve_path), silent=as_json)
        return 0
    how = f"continue with: apil resume {result.directory}"
    say(f"apil: interrupted at {result.steps} steps; {how}")
    return INTERRUPTED


def print_result(result: RetrainResult) -> None:
    """Print the victim's shares against each opponent, before and after."""
    out = console()
    title = f"{result.victim.name} in {result.env}, retrained {result.steps:,} steps"
    out.print(title, style="bold")
    if result.after:
        rows = [
            (label, when, *_victims_view(scores[label]))
            for label in result.after
            for when, scores in (("before", result.before), ("after", result.after))
            if label in scores
        ]
        out.print(table("against", "the victim", "games>", "wins>", "wins or ties>", rows=rows))
    out.print(f"victim     retrained:{result.directory}", soft_wrap=True)


def _victims_view(score: EvaluationResult) -> tuple[str, str, str]:
    from apil_core.evaluation.results import wilson

    not_lost = wilson(score.losses + score.ties, score.episodes)
    return str(score.episodes), percent(score.loss_rate), percent(not_lost)
