"""``apil run``: one training, or one per seed."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Group, Parameter

from apil_core.cli.finish import exit_code, finish
from apil_core.cli.flags import ConfigFlags, Json, Quiet, Show
from apil_core.cli.output import console, print_json
from apil_core.cli.progress import make_progress
from apil_core.cli.seeds import train_seeds
from apil_core.common.errors import ConfigError
from apil_core.common.extras import need
from apil_core.common.files import refuse_taken
from apil_core.common.numbers import number_list
from apil_core.training.distributed.world import World

if TYPE_CHECKING:
    from apil_core.api.config import RunConfig
    from apil_core.plugins.discovery import PluginRegistry

_OUTPUT = Group("How often, where to", sort_key=2)


def seed_list(_: Any, tokens: Any) -> list[int]:
    """``0..4`` (both ends included), ``0,3,7``, or both."""
    return number_list(tokens[0].value)


Seeds = Annotated[
    list[int] | None,
    Parameter(
        converter=seed_list,
        n_tokens=1,
        metavar="SEEDS",
        group=_OUTPUT,
        help="Several runs, with one table and one curve over all: 0..4 or 0,3,7.",
    ),
]


def run(
    *,
    flags: ConfigFlags | None = None,
    seeds: Seeds = None,
    workers: Annotated[
        int | None,
        Parameter(group=_OUTPUT, help="With --seeds: trainings at a time [default: one per CPU]."),
    ] = None,
    out: Annotated[
        Path | None,
        Parameter(
            group=_OUTPUT,
            help="Run directory [default: runs/ENV/METHOD/TIME-sSEED]; with --seeds, one below it each.",
        ),
    ] = None,
    dry_run: Annotated[
        bool,
        Parameter(
            group=_OUTPUT,
            show_default=False,
            help="Build and try it all, say what it costs, write nothing.",
        ),
    ] = False,
    show: Show = False,
    quiet: Quiet = False,
    as_json: Json = False,
) -> int:
    """Train an adversary against a frozen victim, then score it.

    Ctrl-C writes a checkpoint; "apil resume" resumes from it, bit for bit.
    """
    config, plugins = (flags or ConfigFlags()).resolve()
    if workers is not None and seeds is None:
        raise ConfigError("--workers: trainings at a time, so it needs --seeds")
    if show:
        need("matplotlib", "av")
    here = World.here()
    if here.is_main:
        refuse_taken(out)
    if dry_run:
        if here.is_main:
            _say_budget(config, plugins, out or Path("runs"), len(seeds or [0]), as_json=as_json)
        return 0
    if seeds is not None:
        return train_seeds(config, seeds, out, workers, show=show, quiet=quiet, as_json=as_json)
    from apil_core.runs import runner

    command = ["apil", *sys.argv[1:]]
    with make_progress(quiet=quiet or not here.is_main) as progress:
        result = runner.run(config, out=out, progress=progress, command=command, plugins=plugins)
        document = finish(result, progress, show=show, as_json=as_json) if here.is_main else {}
    if as_json and here.is_main:
        print_json(document)
    return exit_code(result, here)


def _say_budget(
    config: RunConfig, plugins: PluginRegistry, place: Path, seeds: int, *, as_json: bool
) -> None:
    """Print the composition and cost of one run, and the duration of all seeds."""
    from apil_core.runs import dry_run

    found = dry_run.dry_run(config, plugins, place)
    if as_json:
        print_json(found)
        return
    hours = seeds * (found.training_hours + found.scoring_hours)
    lines = [
        f"{found.method} on {found.env}, device {found.device}: everything fits, nothing was written",
        f"victim     {found.victim} (sha256 {found.victim_sha256[:12]}), the {found.victim_side}",
        f"adversary  the {found.adversary_side}, {found.parameters:,} parameters, critics included",
        f"training   {found.steps:,} steps at {found.steps_per_second:,.0f} a second, measured now: "
        f"{found.training_hours:.2g} h; iterations: {found.iterations:,}",
        f"scoring    {found.games:,} games: about {found.scoring_hours:.2g} h; evaluations on the way: "
        f"{found.evaluations}",
        f"disk       about {found.disk_mb:,.0f} MB ({found.disk_free_mb:,.0f} MB free)",
        f"in all     about {hours:.2g} h, {seeds * found.disk_mb:,.0f} MB"
        + (f" for {seeds} seeds" if seeds > 1 else ""),
    ]
    for line in lines:
        console().print(line)
