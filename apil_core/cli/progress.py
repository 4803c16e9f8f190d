"""Choosing how a run shows itself: live on a terminal, plain lines elsewhere, or not at all."""

from __future__ import annotations

import sys

from apil_core.cli.plain import ConsoleProgress


def make_progress(*, quiet: bool = False) -> ConsoleProgress:
    """The progress that fits ``--quiet`` and the terminal. It writes to stderr: stdout is for results."""
    if quiet:
        return ConsoleProgress()
    if sys.stderr.isatty():
        from apil_core.cli.live import LiveProgress

        return LiveProgress()
    from apil_core.cli.plain import PlainProgress

    return PlainProgress()
