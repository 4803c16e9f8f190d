"""``apil bench speed``."""

from __future__ import annotations

import sys
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Group, Parameter

from apil_core.cli.flags import Json, Plugins, Quiet, count
from apil_core.cli.guard import INTERRUPTED, complain
from apil_core.cli.output import print_json
from apil_core.common.errors import ConfigError
from apil_core.config.layers import preset_names

if TYPE_CHECKING:
    from apil_core.studies.speed.report import SpeedReport

_WHAT = Group("What to measure: every combination of", sort_key=0)
_HOW = Group("How", sort_key=1)

REPORT, PICTURE = "speed.json", "speed.png"


def _listed(_: Any, tokens: Any) -> list[str]:
    """Words between commas, of one flag or of several."""
    words = [word.strip() for token in tokens for word in token.value.split(",")]
    if not all(words):
        raise ValueError("an empty word between commas")
    return words


def _numbers(_: Any, tokens: Any) -> list[int]:
    return [int(word) for word in _listed(_, tokens)]


def _axis(text: str, **options: Any) -> Parameter:
    return Parameter(help=text, group=_WHAT, converter=_listed, negative=(), **options)


def speed(
    *,
    env: Annotated[
        list[str] | None, _axis("Games, or all [default: kick-and-defend].", alias="-e", metavar="GAME,…")
    ] = None,
    methods: Annotated[
        list[str] | None,
        _axis("Methods whose training is measured [default: adrl,e_apil].", alias="-m", metavar="NAME,…"),
    ] = None,
    num_envs: Annotated[
        list[int] | None,
        Parameter(
            help="Games stepped together, e.g. 16,64,128,256,512 [default: as the settings have it].",
            group=_WHAT,
            converter=_numbers,
            metavar="N,…",
        ),
    ] = None,
    threads: Annotated[
        list[int] | None,
        Parameter(
            help="Physics threads; 0: all CPUs [default: 0].", group=_WHAT, converter=_numbers, metavar="N,…"
        ),
    ] = None,
    physics: Annotated[
        list[str] | None,
        _axis(
            "Physics profiles of the games: faithful, fast [default: the games' own].", metavar="PROFILE,…"
        ),
    ] = None,
    levels: Annotated[
        list[str] | None,
        Parameter(
            help="Only these: physics, game, victim, collection, training, direct [default: all].",
            group=_HOW,
            converter=_listed,
            metavar="LEVEL,…",
        ),
    ] = None,
    preset: Annotated[
        list[str] | None,
        Parameter(
            help=f"Settings of the trainings: {', '.join(preset_names())}; repeatable.",
            group=_HOW,
            negative=(),
            metavar="NAME",
        ),
    ] = None,
    victim: Annotated[str, Parameter(help="Policy under attack; auto: the game's.", group=_HOW)] = "auto",
    seconds: Annotated[
        float,
        Parameter(help="Time for each setting; three rounds are made whatever they take.", group=_HOW),
    ] = 300.0,
    batch: Annotated[
        int | None,
        Parameter(
            help="Environment steps of a block, which are PPO's batch [default: as the settings have it].",
            converter=count,
            group=_HOW,
        ),
    ] = None,
    out: Annotated[
        Path | None, Parameter(help=f"Directory to keep {REPORT} and {PICTURE} in.", group=_HOW)
    ] = None,
    force: Annotated[
        bool, Parameter(show_default=False, help="Replace those files if they exist.", group=_HOW)
    ] = False,
    plugin: Plugins | None = None,
    quiet: Quiet = False,
    as_json: Json = False,
) -> int:
    """Measure physics alone, games, victim, collection and training, in turns and on the same games.

    Rates depend on the machine and on what else it does. Ratios to the physics, on identical work done
    seconds apart, say what everything else costs. Numbers are medians and quartiles over blocks; see
    docs/benchmarking.md. Ctrl-C keeps the settings that are finished.
    """
    from apil_core.cli.speed_progress import make_speed_progress
    from apil_core.cli.speed_table import print_report
    from apil_core.plugins.discovery import discover
    from apil_core.studies.speed.bench import measure
    from apil_core.studies.speed.plan import SpeedRequest, make_plan

    axes: dict[str, Any] = {
        "envs": env,
        "methods": methods,
        "num_envs": num_envs,
        "threads": threads,
        "physics": physics,
        "levels": levels,
        "presets": preset,
    }
    given = {name: value for name, value in axes.items() if value is not None}
    plugins = discover(plugin or [])
    request = SpeedRequest(**given, victim=victim, batch=batch, seconds=seconds, trust=True)
    cells = make_plan(request, plugins)
    _check_out(out, force)
    with closing(make_speed_progress(cells, quiet=quiet)) as watch:
        report = measure(
            cells,
            plugins,
            command=["apil", *sys.argv[1:]],
            watch=watch,
            keep=lambda so_far: _keep(so_far, out),
        )
    if as_json:
        print_json(report)
    else:
        print_report(report, out)
    if report.interrupted:
        return complain(f"interrupted; {len(report.cells)} of {len(cells)} settings measured", INTERRUPTED)
    return 0


def _check_out(out: Path | None, force: bool) -> None:
    """Whether the files can be written, before minutes of measuring.

    Raises:
        ConfigError: they cannot, or would replace others.
    """
    from apil_core.common.files import why_unwritable

    if out is None:
        return
    for name in (REPORT, PICTURE):
        if (out / name).exists() and not force:
            raise ConfigError(f"{out / name} exists already; choose another --out, or --force to replace it")
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"--out {out}: {error.strerror}") from error
    reason = why_unwritable(out)
    if reason:
        raise ConfigError(f"--out {out}: {reason}")


def _keep(report: SpeedReport, out: Path | None) -> None:
    """Write what is measured so far."""
    from apil_core.studies.speed.picture import draw_speed

    if out is not None:
        report.write(out / REPORT)
        draw_speed(report, out / PICTURE)
