"""Progress for logs and pipes: one line now and then."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

from apil_core.cli import readout

if TYPE_CHECKING:
    from apil_core.api.config import RunConfig
    from apil_core.evaluation.results import EvaluationResult
from types import TracebackType
from typing import TYPE_CHECKING, Self

from apil_core.common.visible import visible
from apil_core.evaluation.progress import Progress
from apil_core.training.distributed.world import World

SECONDS_BETWEEN_LINES = 10.0


class ConsoleProgress(Progress):
    """A progress that tidies up the terminal when its ``with`` block ends. Shows nothing itself."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Leave the terminal as it was; closing twice is fine."""

    @staticmethod
    def headline(config: RunConfig, run_dir: Path, victim: str, steps_done: int) -> str:
        """What runs, and where."""
        resumed = f", continued at {steps_done:,} steps" if steps_done else ""
        batch = f"{config.num_envs} games × {config.ppo.num_steps} steps"
        processes = World.here().size
        batch = batch if processes == 1 else f"{processes} processes × {batch}"
        what = f"{config.method} against {victim} in {config.env}, seed {config.seed}"
        return f"{what}, {batch}{resumed} → {run_dir}"


class PlainProgress(ConsoleProgress):
    """A line for the first iteration, for the last, and about every ten seconds in between.

    Args:
        stream: where lines go; default stderr.
        every: seconds between lines.
    """

    def __init__(self, stream: TextIO | None = None, every: float = SECONDS_BETWEEN_LINES):
        self.stream = stream or sys.stderr
        self.every = every
        self._next = 0.0
        self._endings = readout.Endings()

    def started(self, config: RunConfig, run_dir: Path, victim: str, steps_done: int) -> None:
        """Say what runs, and where."""
        self.note(self.headline(config, run_dir, victim, steps_done))

    def iteration(self, metrics: dict[str, float]) -> None:
        """One line if it is time for one."""
        self._endings.add(metrics)
        is_last = metrics["steps"] >= metrics["total_steps"]
        if time.monotonic() >= self._next or is_last:
            self._next = time.monotonic() + self.every
            self.note(self._line(metrics))

    def evaluation_progress(self, done: int, total: int) -> None:
        """A line now and then."""
        if time.monotonic() >= self._next and done < total:
            self._next = time.monotonic() + self.every
            self.note(f"evaluation: {done} of {total} games")

    def evaluation(self, result: EvaluationResult, steps: int) -> None:
        """One line per evaluation."""
        self.note(readout.score_line(result, steps))

    def note(self, text: str) -> None:
        """One line, at once."""
        print(visible(text), file=self.stream, flush=True)

    def _line(self, metrics: dict[str, float]) -> str:
        steps, total = metrics["steps"], metrics["total_steps"]
        speed = metrics["steps_per_second"]
        left = readout.duration((total - steps) / speed) if speed and steps < total else "0:00"
        parts = [
            f"iteration {metrics['iteration']:.0f}: {steps:,.0f} of {total:,.0f} steps",
            f"{speed:,.0f} steps/s, {left} left",
            ", ".join(f"{name} {text}" for name, text in readout.outcomes(metrics).items()),
            f"returns: {text}" if (text := readout.returns(metrics)) else "",
            readout.imitator(metrics),
            f"endings: {self._endings}" if str(self._endings) else "",
        ]
        return " | ".join(part for part in parts if part)
