"""What ``apil run`` and ``apil resume`` say when a run ends, and their exit code."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from apil_core.cli.guard import INTERRUPTED

if TYPE_CHECKING:
    from apil_core.runner import RunResult


def print_end(result: RunResult) -> None:
    """The final score (or where the run stands), and the next command one may want."""
    from apil_core.cli.output import console
    from apil_core.cli.scores import print_score

    if result.evaluation is not None:
        print_score(result.evaluation)
    if result.status == "finished":
        console().print(f"run        {result.run_dir}, {result.steps:,} steps", markup=False)


def exit_code(result: RunResult) -> int:
    """0, or 130 with a word on how to go on after Ctrl-C."""
    if result.status == "finished":
        return 0
    print(
        f"apil: interrupted at {result.steps} steps; continue with: apil resume {result.run_dir}",
        file=sys.stderr,
    )
    return INTERRUPTED
