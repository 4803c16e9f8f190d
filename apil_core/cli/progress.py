"""Choosing how a run shows itself: live on a terminal, plain lines elsewhere, or not at all."""

from __future__ import annotations

import sys
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Self

from apil_core.distributed.world import World
from apil_core.progress import Progress

if TYPE_CHECKING:
    from apil_core.config import RunConfig


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


def make_progress(*, quiet: bool = False) -> ConsoleProgress:
    """The progress that fits ``--quiet`` and the terminal. It writes to stderr: stdout is for results."""
    if quiet:
        return ConsoleProgress()
    if sys.stderr.isatty():
        from apil_core.cli.live import LiveProgress

        return LiveProgress()
    from apil_core.cli.plain import PlainProgress

    return PlainProgress()
