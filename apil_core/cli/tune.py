"""``apil tune``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from apil_core.cli.bench_work import follow_supervisor
from apil_core.cli.flags import ConfigFlags, Json, Quiet
from apil_core.cli.guard import INTERRUPTED, complain
from apil_core.cli.output import console, print_json, say, table
from apil_core.cli.readout import percent
from apil_core.common.errors import ConfigError
from apil_core.common.extras import need
from apil_core.studies.tune.space import TRIALS, Space, space_names

if TYPE_CHECKING:
    from apil_core.studies.tune.folder import StudyDir
    from apil_core.studies.tune.tune import TuneResult

_SHOWN = 10
"""Trials in the table."""


def tune(
    space: Annotated[
        str,
        Parameter(
            name="SPACE",
            help=f"YAML file, a method whose space is shipped ({', '.join(space_names())}), or a study.",
        ),
    ],
    /,
    *,
    flags: ConfigFlags | None = None,
    trials: Annotated[
        int | None, Parameter(help="Trials in all [default: 20, or as many as the study has].")
    ] = None,
    workers: Annotated[int, Parameter(help="Trials at the same time, in processes.")] = 1,
    out: Annotated[
        Path | None, Parameter(help="Directory [default: runs/tune/ENV/METHOD]; continued if it exists.")
    ] = None,
    dry_run: Annotated[
        bool,
        Parameter(show_default=False, help="Check and print the space, say what it costs, write nothing."),
    ] = False,
    quiet: Quiet = False,
    as_json: Json = False,
    worker: Annotated[bool, Parameter(show=False)] = False,
) -> int:
    """Look for the settings of an attack that win most: many trainings, those that fall behind ended early.

    A key given as a flag or by --set is not varied. The same command resumes an interrupted study: trials in
    progress go on from their checkpoints. The best trial's settings become best.yaml, for apil run --config.
    """
    need("optuna", "matplotlib")
    for name, value in (("--trials", trials), ("--workers", workers)):
        if value is not None and value < 1:
            raise ConfigError(f"{name} must be at least 1, got {value}")
    directory, checked = _study(space, flags or ConfigFlags(), out)
    note = None if quiet else say
    if worker:
        from apil_core.studies.tune.work import work

        follow_supervisor()
        return (
            0
            if work(directory, checked, trials or TRIALS, checked.config.threads, note or str)
            else INTERRUPTED
        )
    if dry_run:
        return _say_budget(directory, checked, trials or TRIALS, workers, as_json=as_json)
    from apil_core.studies.tune.tune import run_study

    result = run_study(directory, checked, trials, workers, note)
    _print(result, as_json=as_json)
    if result.status == "interrupted":
        return complain(f"interrupted; go on with: apil tune {result.path}", INTERRUPTED)
    return 0 if result.best else complain("no trial was completed", 1)


def _study(name: str, flags: ConfigFlags, out: Path | None) -> tuple[StudyDir, Space]:
    """The directory and the checked space."""
    from apil_core.studies.tune.folder import StudyDir
    from apil_core.studies.tune.tune import ROOT, evaluated

    if Path(name).is_dir():
        given = [*flags.given(), *flags.preset, *flags.set, *flags.plugin, *filter(None, (flags.config, out))]
        if set(given) - {"threads"}:
            raise ConfigError(
                f"{name} has its settings already: only --trials, --workers and --threads can be given"
            )
        space = (directory := StudyDir(name)).space()
        threads = flags.given().get("threads", space.config.threads)
        space.config = space.config.model_copy(update={"threads": threads})
        return directory, space
    if name in space_names() and not Path(name).is_file() and "method" not in flags.given():
        flags.method = name  # type: ignore[attr-defined]
    fixed = {
        ".".join(map(str, key)) for layer in flags.layers() if layer.command_line for key in layer.origins
    }
    config, plugins = flags.resolve()
    config = evaluated(config)
    return StudyDir(out or ROOT / config.env / config.method), Space(name, config, plugins, frozenset(fixed))


def _say_budget(directory: StudyDir, space: Space, trials: int, workers: int, *, as_json: bool) -> int:
    from apil_core.runs.dry_run import dry_run

    found = dry_run(space.config, space.plugins, directory.path)
    hours = trials * (found.training_hours + found.scoring_hours) / workers
    if as_json:
        print_json({"space": space.content, "trials": trials, "hours": hours, "trial": found})
        return 0
    for key, part in space.content.items():
        console().print(f"{key}: {part}")
    console().print(
        f"{trials} trials of {found.method} on {found.env}, {found.steps:,} steps each: about {hours:.2g} h "
        f"at most, {trials * found.disk_mb:,.0f} MB; nothing was written"
    )
    return 0


def _print(result: TuneResult, *, as_json: bool) -> None:
    if as_json:
        print_json(result)
        return
    rows = table("trial>", "state", "win rate>", "settings")
    ranked = sorted(result.rows, key=lambda row: -1.0 if row["win_rate"] is None else -row["win_rate"])
    for row in ranked[:_SHOWN]:
        settings = list(row.items())[5:]
        words = ", ".join(
            f"{key} {value:.3g}" if isinstance(value, float) else f"{key} {value}" for key, value in settings
        )
        rate = "–" if row["win_rate"] is None else f"{100 * row['win_rate']:.1f} %"
        rows.add_row(str(row["number"]), row["state"], rate, words)
    out = console()
    out.print(rows)
    for name, score in result.scores.items():
        out.print(f"{name:<10} {percent(score.win_rate)} of {score.episodes} other games won")
    if result.best:
        out.print(f"settings   {result.path / 'best.yaml'} (trial {result.number})", soft_wrap=True)
