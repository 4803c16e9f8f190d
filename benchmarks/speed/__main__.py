"""``python -m benchmarks.speed``, in a checkout."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from cyclopts import App, CycloptsError, Group, Parameter

from apil_core.cli.app import read_whole_numbers
from apil_core.cli.flags import Json, Plugins, Quiet
from apil_core.cli.guard import INTERRUPTED, USAGE_ERROR, complain
from apil_core.cli.output import print_json
from apil_core.common.errors import ApilError, ConfigError
from apil_core.common.files import why_unwritable
from apil_core.plugins.discovery import discover

from .plan import CellPlan, SpeedRequest, make_plan
from .report import SpeedReport
from .table import print_report

COMMAND = ("python", "-m", "benchmarks.speed")
REPORT, PICTURE = "speed.json", "speed.png"

_FILES = Group("Files", sort_key=2)

app = App(
    name=" ".join(COMMAND),
    help_format="plaintext",
    version_flags=(),
    default_parameter=Parameter(negative=()),
    config=read_whole_numbers,
    result_action="return_value",
    exit_on_error=False,
    print_error=False,
)


@app.default
def speed(
    *,
    request: SpeedRequest | None = None,
    out: Annotated[
        Path | None, Parameter(help=f"Directory to keep {REPORT} and {PICTURE} in.", group=_FILES)
    ] = None,
    force: Annotated[
        bool, Parameter(show_default=False, help="Replace those files if they exist.", group=_FILES)
    ] = False,
    plugin: Plugins | None = None,
    quiet: Quiet = False,
    as_json: Json = False,
) -> int:
    """Measure physics alone, games, victim, collection and training, in turns and on the same games.

    Rates depend on the machine and its load. Ratios to the physics, on identical work done
    seconds apart, show the cost of everything else. Numbers are medians and quartiles over blocks; see
    docs/benchmarking.md. Ctrl-C keeps the settings that are finished.
    """
    from .measure import measure  # imports torch, as --help need not

    plugins = discover(plugin or [])
    cells = make_plan(request or SpeedRequest(), plugins)
    if out is not None:
        _check_out(out, force)

    def say(text: str) -> None:
        if not quiet:
            print(text, file=sys.stderr, flush=True)

    def keep(report: SpeedReport) -> None:
        if out is not None:
            from .picture import draw_speed

            report.write(out / REPORT)
            draw_speed(report, out / PICTURE)

    say(_announcement(cells))
    report = measure(cells, plugins, command=[*COMMAND, *sys.argv[1:]], say=say, keep=keep)
    if as_json:
        print_json(report)
    else:
        print_report(report, out)
    if report.interrupted:
        return complain(f"interrupted; {len(report.cells)} of {len(cells)} settings measured", INTERRUPTED)
    return 0


def _check_out(out: Path, force: bool) -> None:
    """Check that the files can be written, before minutes of measuring.

    Raises:
        ConfigError: they cannot, or would replace others.
    """
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


def _announcement(cells: Sequence[CellPlan]) -> str:
    """Describe the planned measurements and their duration."""
    first = cells[0]
    config = first.any_config
    seconds = sum(cell.seconds for cell in cells)
    what = f"{len(cells)} setting{'s' * (len(cells) > 1)}: {first}{', …' * (len(cells) > 1)}"
    block = f"{config.num_envs * config.ppo.num_steps:,} steps a block"
    return (
        f"measuring {what}; {', '.join(first.configs)}; {', '.join(first.levels)}; {block}\n"
        f"about {seconds / 60:.0f} min in all; longer where three rounds take more than {first.seconds:g} s"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; errors are one line each on stderr, with a non-zero exit code."""
    try:
        return app(arguments)
    except ApilError as error:
        return complain(str(error), error.exit_code)
    except CycloptsError as error:
        return complain(" ".join(str(error).split()), USAGE_ERROR)
    except KeyboardInterrupt:
        return complain("interrupted", INTERRUPTED)


if __name__ == "__main__":
    sys.exit(main())
