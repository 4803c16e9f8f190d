"""Where text goes: results to stdout, everything else (and with ``--json`` everything) to stderr."""

from __future__ import annotations

import json
import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table


_UNFOLDED = 2000
"""Columns where nobody's screen is the limit: rows in a pipe must stay one line each."""


def console(*, stderr: bool = False) -> Console:
    """A rich console; plain text without colour or folding when the stream is not a terminal."""
    from rich.console import Console

    stream = sys.stderr if stderr else sys.stdout
    width = None if stream.isatty() else _UNFOLDED
    return Console(file=stream, width=width, highlight=False, soft_wrap=not stream.isatty())


def table(*columns: str) -> Table:
    """A table in the one style of all commands; a column name ending in ``>`` is right-aligned."""
    from rich import box
    from rich.table import Table

    made = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for column in columns:
        made.add_column(column.rstrip(">"), justify="right" if column.endswith(">") else "left")
    return made


def print_json(value: Any) -> None:
    """The one JSON document of a ``--json`` command."""
    if hasattr(value, "model_dump"):
        value = value.model_dump(mode="json")
    print(json.dumps(value, indent=2, default=str, ensure_ascii=False))
