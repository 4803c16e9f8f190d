"""The command line. ``main`` is the console script ``apil``; one file per group of commands."""

from __future__ import annotations

import sys
from collections.abc import Sequence


def main(arguments: Sequence[str] | None = None) -> None:
    """Run ``apil`` with ``arguments`` (default: those of the process) and exit."""
    from apil_core.cli.guard import guarded

    sys.exit(guarded(list(sys.argv[1:] if arguments is None else arguments)))
