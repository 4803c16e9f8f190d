"""Progress of a run on stderr: live on a terminal, plain lines elsewhere, or none."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Self, TextIO

from apil_core.cli import readout
from apil_core.cli.output import columns
from apil_core.common.visible import visible
from apil_core.evaluation.progress import Progress
from apil_core.training.distributed.world import World

if TYPE_CHECKING:
    from apil_core.api.config import RunConfig
    from apil_core.evaluation.results import EvaluationResult

SECONDS_BETWEEN_LINES = 10.0


class ConsoleProgress(Progress):
    """A progress that restores the terminal when its ``with`` block ends. Prints nothing itself."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Restore the terminal; may be called twice."""

    @staticmethod
    def headline(config: RunConfig, run_dir: Path, victim: str, steps_done: int) -> str:
        """Return the first line: the run's method, victim, game, seed, batch size and directory."""
        resumed = f", continued at {steps_done:,} steps" if steps_done else ""
        batch = f"{config.num_envs} games × {config.ppo.num_steps} steps"
        processes = World.here().size
        batch = batch if processes == 1 else f"{processes} processes × {batch}"
        what = f"{config.method} against {victim} in {config.env}, seed {config.seed}"
        return f"{what}, {batch}{resumed} → {run_dir}"


class PlainProgress(ConsoleProgress):
    """Prints a line for the first iteration, for the last, and about every ten seconds in between.

    Args:
        stream: where lines go; default stderr.
        every: seconds between lines.
    """

    def __init__(self, stream: TextIO | None = None, every: float = SECONDS_BETWEEN_LINES):
        self.stream = stream or sys.stderr
        self.every = every
        self._next = 0.0
        self._pace = readout.Pace()

    def started(self, config: RunConfig, run_dir: Path, victim: str, steps_done: int) -> None:
        """Print the first line."""
        self.note(self.headline(config, run_dir, victim, steps_done))

    def iteration(self, metrics: dict[str, float]) -> None:
        """Print one line if it is due."""
        left = self._pace.left(metrics)
        if self._due() or metrics["steps"] >= metrics["total_steps"]:
            self.note(joined(readout.iteration(metrics, left)))

    def evaluation_progress(self, done: int, total: int) -> None:
        """Print a line every few seconds."""
        left = self._pace.games_left(done, total)
        if done < total and self._due():
            self.note(f"evaluation: {done} of {total} games, {left} left")

    def evaluation(self, result: EvaluationResult, steps: int) -> None:
        """Print one line per evaluation."""
        self.note(readout.score_line(result, steps))

    def note(self, text: str) -> None:
        """Print one line immediately."""
        print(visible(text), file=self.stream, flush=True)

    def _due(self) -> bool:
        if time.monotonic() < self._next:
            return False
        self._next = time.monotonic() + self.every
        return True


def joined(parts: Sequence[str]) -> str:
    """Join the parts of a message with bars; wrap what is wider than the screen, indented."""
    lines = [""]
    for part in filter(None, parts):
        longer = f"{lines[-1]} | {part}" if lines[-1].strip() else lines[-1] + part
        if len(longer) > columns() and lines[-1].strip():
            lines.append(f"    {part}")
        else:
            lines[-1] = longer
    return "\n".join(lines)


def make_progress(*, quiet: bool = False) -> ConsoleProgress:
    """Make the progress for ``--quiet`` and the terminal. It writes to stderr: stdout is for results."""
    if quiet:
        return ConsoleProgress()
    if sys.stderr.isatty():
        from apil_core.cli.live import LiveProgress

        return LiveProgress()
    return PlainProgress()
