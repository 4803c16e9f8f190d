"""Output streams: results to stdout, everything else (and with ``--json`` everything) to stderr."""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import fields, is_dataclass
from typing import TYPE_CHECKING, Any

from apil_core.common.visible import visible

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text


_UNFOLDED = 2000
"""Width without a terminal: each row in a pipe must stay on one line."""

WIDEST = 120
"""Columns of a progress display at most: a bar across a whole wide screen is hard to read."""


def columns() -> int:
    """Width of progress displays: the terminal's or ``COLUMNS``, at most 120."""
    return min(shutil.get_terminal_size((WIDEST, 24)).columns, WIDEST)


def console(*, stderr: bool = False) -> Console:
    """Make a rich console; plain text without colour or folding when the stream is not a terminal.

    Texts are shown as they are, without markup and emoji; :func:`styled` has colour.
    """
    from rich.console import Console

    class Screen(Console):
        def render_str(self, text: str, **how: Any) -> Text:
            return super().render_str(visible(text), **how)

    stream = sys.stderr if stderr else sys.stdout
    width = None if stream.isatty() else _UNFOLDED
    return Screen(
        file=stream, width=width, highlight=False, markup=False, emoji=False, soft_wrap=not stream.isatty()
    )


def styled(text: str, style: str) -> Text:
    """Return the text in a colour."""
    from rich.text import Text

    return Text(visible(text), style)


def say(text: str) -> None:
    """Print a line on stderr."""
    print(visible(text), file=sys.stderr, flush=True)


def table(*columns: str, rows: Iterable[Sequence[str | Text]] = ()) -> Table:
    """Make a table in the style of all commands; a column name ending in ``>`` is right-aligned."""
    from rich import box
    from rich.table import Table

    made = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for column in columns:
        made.add_column(column.rstrip(">"), justify="right" if column.endswith(">") else "left")
    for row in rows:
        made.add_row(*row)
    return made


def print_facts(**facts: object) -> None:
    """Print a line for each name and value; without a value there is none."""
    for name, value in facts.items():
        if value is not None:
            console().print(f"{name.replace('_', ' '):<10} {value}", soft_wrap=True)


def print_json(value: Any) -> None:
    """Print the one JSON document of a ``--json`` command; models and dataclasses become objects."""

    def plain(part: Any) -> Any:
        if is_dataclass(part) and not isinstance(part, type):
            return {field.name: getattr(part, field.name) for field in fields(part)}
        return part.model_dump(mode="json") if hasattr(part, "model_dump") else str(part)

    print(visible(json.dumps(value, indent=2, default=plain, ensure_ascii=False)))


def emit(value: Any, as_json: bool, printer: Callable[[], object]) -> None:
    """Print the result of a command: as JSON, or what ``printer`` prints for people."""
    if as_json:
        print_json(value)
    else:
        printer()
