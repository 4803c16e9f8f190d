"""The live view of a training or an evaluation on a terminal."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console, Group
from rich.live import Live
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
)
from rich.table import Table
from rich.text import Text

from apil_core.cli import readout
from apil_core.cli.output import WIDEST, console
from apil_core.cli.progress import ConsoleProgress
from apil_core.common.visible import visible

if TYPE_CHECKING:
    from apil_core.api.config import RunConfig
    from apil_core.evaluation.results import EvaluationResult


class LiveProgress(ConsoleProgress):
    """A progress bar with the time left, and game statistics below it.

    Args:
        screen: rich console; default stderr.
    """

    def __init__(self, screen: Console | None = None):
        self._console = screen or console(stderr=True)
        self._console.width = min(self._console.width, WIDEST)
        self._bars = Progress(
            TextColumn("{task.description}"),
            BarColumn(bar_width=None),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TextColumn("{task.fields[left]} left"),
            console=self._console,
            expand=True,
        )
        self._live = Live(console=self._console, refresh_per_second=4, transient=False)
        self._training: TaskID | None = None
        self._evaluating: TaskID | None = None
        self._pace = readout.Pace()
        self._status: Table | None = None

    def started(self, config: RunConfig, run_dir: Path, victim: str, steps_done: int) -> None:
        """Print the headline and an empty bar."""
        self.note(self.headline(config, run_dir, victim, steps_done))
        self._training = self._bars.add_task("training", total=config.steps, completed=steps_done, left="–")
        self._refresh()

    def iteration(self, metrics: dict[str, float]) -> None:
        """Advance the bar and update the numbers."""
        self._status = status_table(metrics)
        left = self._pace.left(metrics)
        if self._training is not None:
            done = min(metrics["steps"], metrics["total_steps"])
            total = metrics["total_steps"]
            self._bars.update(self._training, total=total, completed=int(done), left=left)
        self._refresh()

    def evaluation_progress(self, done: int, total: int) -> None:
        """Show a second bar while an evaluation runs."""
        if self._evaluating is None:
            self._evaluating = self._bars.add_task("evaluation", total=total, left="–")
        left = self._pace.games_left(done, total)
        self._bars.update(self._evaluating, total=total, completed=done, left=left)
        self._refresh()

    def evaluation(self, result: EvaluationResult, steps: int) -> None:
        """Print the score as a line above the live part."""
        self._drop_evaluation()
        self.note(readout.score_line(result, steps))

    def note(self, text: str) -> None:
        """Print a line above the live part."""
        self._console.print(Text(visible(text)))

    def finished(self, run_dir: Path) -> None:
        """Stop updating the view."""
        self.close()

    def close(self) -> None:
        """Stop the live part and restore the terminal."""
        self._drop_evaluation()
        if self._live.is_started:
            self._refresh()
            self._live.stop()

    def _drop_evaluation(self) -> None:
        if self._evaluating is not None:
            self._bars.remove_task(self._evaluating)
            self._evaluating = None

    def _refresh(self) -> None:
        if not self._live.is_started:
            self._live.start()
        parts = [self._bars] if self._status is None else [self._bars, self._status]
        self._live.update(Group(*parts))


def status_table(metrics: dict[str, float]) -> Table:
    """Make the table below the bar, one row per metric."""
    games = f"last {metrics.get('window_games', 0):,.0f} games"
    shares = readout.outcomes(metrics)
    rows = {
        "speed": readout.speed(metrics),
        games: "  ".join(f"{name} {text}" for name, text in shares.items()),
        "returns": readout.returns(metrics),
        "imitator": readout.imitator(metrics),
        "endings": readout.endings(metrics),
    }
    grid = Table.grid(padding=(0, 2))
    grid.add_column(style="dim", no_wrap=True)
    grid.add_column()
    for name, text in rows.items():
        if text:
            grid.add_row(name, Text(visible(text)))
    return grid
