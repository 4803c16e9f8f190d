"""How ``apil bench speed`` shows that it goes on: a bar on a terminal, a line now and then elsewhere."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING

from apil_core.cli.output import console
from apil_core.cli.readout import duration
from apil_core.studies.speed.bench import SpeedWatch

if TYPE_CHECKING:
    from rich.console import Console

    from apil_core.studies.speed.plan import CellPlan
    from apil_core.studies.speed.report import SpeedReport


class QuietWatch(SpeedWatch):
    """Says nothing, and tidies up when it is closed."""

    def close(self) -> None:
        """Leave the terminal as it was."""


class LineWatch(QuietWatch):
    """A line for each setting's beginning and end, on stderr."""

    def __init__(self, cells: Sequence[CellPlan]):
        self._cells = cells
        self._begun = -1
        self._say(announcement(cells))

    def stage(self, index: int, plan: CellPlan, text: str, share: float) -> None:
        """See :class:`SpeedWatch`."""
        if index != self._begun:
            self._begun = index
            self._say(f"{index + 1} of {len(self._cells)}: {plan}")

    def cell(self, index: int, report: SpeedReport) -> None:
        """See :class:`SpeedWatch`."""
        done = report.cells[-1]
        self._say(f"{index + 1} of {len(self._cells)}: {done.rounds} rounds in {duration(done.wall_seconds)}")

    def _say(self, text: str) -> None:
        print(text, file=sys.stderr, flush=True)


class BarWatch(QuietWatch):
    """A bar over all settings.

    Args:
        cells: the settings.
        screen: rich console; default stderr.
    """

    def __init__(self, cells: Sequence[CellPlan], screen: Console | None = None):
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

        screen = screen or console(stderr=True)
        screen.print(announcement(cells), markup=False)
        self._cells = cells
        self._bars = Progress(
            TextColumn("{task.description}", markup=False),
            BarColumn(),
            TimeElapsedColumn(),
            TextColumn("left, about"),
            TimeRemainingColumn(),
            console=screen,
            transient=True,
            speed_estimate_period=600,
        )
        self._task = self._bars.add_task("", total=len(cells))
        self._bars.start()

    def stage(self, index: int, plan: CellPlan, text: str, share: float) -> None:
        """See :class:`SpeedWatch`."""
        place = f"{index + 1}/{len(self._cells)} " if len(self._cells) > 1 else ""
        self._bars.update(self._task, description=f"{place}{plan}: {text}", completed=index + share)

    def close(self) -> None:
        """See :class:`QuietWatch`."""
        self._bars.stop()


def announcement(cells: Sequence[CellPlan]) -> str:
    """What is going to be measured, and about how long that takes."""
    first = cells[0]
    config = first.any_config
    total = duration(sum(cell.seconds for cell in cells))
    what = f"{len(cells)} setting{'s' * (len(cells) > 1)}: {first}{', …' * (len(cells) > 1)}"
    block = f"{config.num_envs * config.ppo.num_steps:,} steps a block"
    return (
        f"measuring {what}; {', '.join(first.configs)}; {', '.join(first.levels)}; {block}\n"
        f"about {total} in all; longer where three rounds of a setting take more than {first.seconds:g} s"
    )


def make_speed_progress(cells: Sequence[CellPlan], *, quiet: bool) -> QuietWatch:
    """What fits ``--quiet`` and the terminal."""
    if quiet:
        return QuietWatch()
    return BarWatch(cells) if sys.stderr.isatty() else LineWatch(cells)
