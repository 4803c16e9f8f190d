"""``apil retrain``."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Group, Parameter

from apil_core.api.profiles import Profile
from apil_core.cli.flags import PHYSICS_HELP, Json, Quiet
from apil_core.cli.guard import INTERRUPTED, complain
from apil_core.cli.output import console, print_json, say, table
from apil_core.cli.progress import make_progress
from apil_core.cli.readout import percent
from apil_core.common.errors import ApilError, RunDirError
from apil_core.common.files import is_taken
from apil_core.runs.retraining.config import RetrainConfig

if TYPE_CHECKING:
    from apil_core.evaluation.results import EvaluationResult
    from apil_core.runs.retraining.scoring import RetrainResult

_WHO = Group("Who is hardened against whom", sort_key=0)
_HOW = Group("How", sort_key=1)


def _setting(name: str, group: Group, **options: Any) -> Parameter:
    """A flag of one setting: its help is the setting's own text and default."""
    info = RetrainConfig.model_fields[name]
    default = "" if info.is_required() or info.default is None else f" [default: {info.default}]"
    return Parameter(help=f"{info.description}{default}", group=group, show_default=False, **options)


@Parameter(name="*")
@dataclass
class RetrainFlags:
    """The settings of a retraining; what is not given is as in the first run, or a default."""

    env: Annotated[str | None, Parameter(alias="-e", group=_WHO, help="Game [default: the runs'].")] = None
    victim: Annotated[
        str | None, Parameter(group=_WHO, help="Policy to harden [default: the one the runs attacked].")
    ] = None
    baseline: Annotated[str | None, _setting("baseline", _WHO)] = None
    adversary_share: Annotated[float | None, _setting("adversary_share", _WHO)] = None
    mix: Annotated[Literal["per_episode", "per_step"] | None, _setting("mix", _WHO)] = None
    physics: Annotated[
        Profile | None,
        Parameter(group=_HOW, help=f"Physics profile; {PHYSICS_HELP} [default: the first run's]."),
    ] = None
    steps: Annotated[int | None, _setting("steps", _HOW)] = None
    num_envs: Annotated[
        int | None, Parameter(group=_HOW, help="Games stepped together [default: the first run's].")
    ] = None
    critic: Annotated[Literal["auto", "stored", "new"] | None, _setting("critic", _HOW)] = None
    freeze: Annotated[Literal["none", "value"] | None, _setting("freeze", _HOW)] = None
    episodes: Annotated[
        int | None, Parameter(group=_HOW, help="Games of each score, before and after [default: 1000].")
    ] = None
    seed: Annotated[int | None, _setting("seed", _HOW)] = None
    threads: Annotated[int | None, _setting("threads", _HOW)] = None
    device: Annotated[str | None, _setting("device", _HOW)] = None
    sets: Annotated[
        list[str],
        Parameter(
            name="--set",
            show_default=False,
            metavar="KEY=VALUE",
            group=_HOW,
            help="Any other setting, e.g. ppo.learning_rate=1e-4 or evaluation.every_steps=500_000.",
        ),
    ] = field(default_factory=list)

    def given(self) -> dict[str, Any]:
        """The flags that were given, as keys of :class:`RetrainConfig`."""
        names = (
            *("env", "victim", "baseline", "adversary_share", "mix", "steps", "num_envs"),
            *("critic", "freeze", "seed", "threads", "device"),
        )
        values = {name: getattr(self, name) for name in names}
        values |= {"game.physics": self.physics, "evaluation.episodes": self.episodes}
        return {name: value for name, value in values.items() if value is not None}


def retrain(
    *adversaries: Annotated[
        str, Parameter(name="RUN", help="Runs whose adversaries the victim shall withstand.", required=True)
    ],
    flags: RetrainFlags | None = None,
    out: Annotated[
        Path | None, Parameter(help="Directory [default: runs/ENV/retrain/OPPONENTS/TIME-sSEED].")
    ] = None,
    quiet: Quiet = False,
    as_json: Json = False,
) -> int:
    """Harden a victim: train it on, against a mixture of adversaries and the one it knows.

    The hardened victim plays anywhere as retrained:DIR. Ctrl-C writes a checkpoint; "apil resume DIR"
    goes on from there, bit for bit.
    """
    flags = flags or RetrainFlags()
    if out is not None and is_taken(out):
        raise RunDirError(
            f"--out {out} exists and is not empty: nothing was changed; "
            f"choose another, or continue it with: apil resume {out}"
        )

    from apil_core.runs.retraining.retrain import retrain as start
    from apil_core.runs.retraining.settings import settings

    config = settings(adversaries, flags.given(), flags.sets)
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
    from apil_core.runs.retraining.retrain import resume as go_on

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
    """Say how a retraining ended; the exit code, 130 after Ctrl-C."""
    if as_json:
        print_json(result)
    elif result.status == "finished":
        print_result(result)
    if result.status == "finished":
        _draw_curve(result, silent=as_json)
        return 0
    how = f"continue with: apil resume {result.directory}"
    say(f"apil: interrupted at {result.steps} steps; {how}")
    return INTERRUPTED


def print_result(result: RetrainResult) -> None:
    """The victim's shares against each opponent on its own, before and after."""
    out = console()
    title = f"{result.victim.name} in {result.env}, retrained {result.steps:,} steps"
    out.print(title, style="bold", markup=False)
    if result.after:
        rows = table("against", "the victim", "games>", "wins>", "wins or ties>")
        for label, after in result.after.items():
            if label in result.before:
                rows.add_row(label, "before", *_victims_view(result.before[label]))
            rows.add_row(label, "after", *_victims_view(after))
        out.print(rows)
    out.print(f"victim     retrained:{result.directory}", markup=False, soft_wrap=True)


def _draw_curve(result: RetrainResult, *, silent: bool) -> None:
    """``curve.png`` in its directory; nothing depends on it, so what keeps it from being made is a note."""
    from apil_core.runs.retraining.folder import RetrainDir
    from apil_core.studies.curves.retraining import draw_opponents

    directory = RetrainDir(result.directory)
    try:
        draw_opponents(directory, directory.curve_path)
    except ApilError as error:
        complain(f"no learning curve: {error}", 0)
        return
    if not silent:
        console().print(f"curve      {directory.curve_path}", markup=False, soft_wrap=True)


def _victims_view(score: EvaluationResult) -> tuple[str, str, str]:
    from apil_core.evaluation.results import wilson

    not_lost = wilson(score.losses + score.ties, score.episodes)
    return str(score.episodes), percent(score.loss_rate), percent(not_lost)
