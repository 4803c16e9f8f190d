"""``apil doctor``."""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from apil_core.cli.flags import Json
from apil_core.cli.output import console, emit, styled, table

if TYPE_CHECKING:
    from apil_core.cli.doctor_checks import Report, Status

_COLOURS: dict[Status, str] = {"ok": "green", "warning": "yellow", "error": "red"}


def doctor(
    *,
    plugin: Annotated[
        list[Path] | None,
        Parameter(name="--plugin", show_default=False, help="One-file plugin to look at too; repeatable."),
    ] = None,
    quick: Annotated[
        bool, Parameter(show_default=False, help="Measure no step rates and draw nothing.")
    ] = False,
    as_json: Json = False,
) -> int:
    """Check this machine: what works, what does not, and what to do about it.

    Checks Python, packages, plugins, presets, processor, GPU, games and their step rates, drawing, victims
    and disk. Takes about half a minute and changes nothing. Exit code 1 if something would keep "apil run"
    from working, else 0.
    """
    report = _examined(plugin or [], quick)
    emit(report, as_json, lambda: _print(report))
    return int(report.status == "error")


def _examined(plugin: list[Path], quick: bool) -> Report:
    from apil_core.cli.doctor_checks import examine

    if not sys.stderr.isatty():
        return examine(plugin, quick=quick)
    with console(stderr=True).status("") as status:
        return examine(plugin, quick=quick, watch=lambda name: status.update(f"looking at {name}"))


def _print(report: Report) -> None:
    from rich.text import Text

    out = console()
    rows = table("", "what", "found")
    rows.columns[-1].overflow = "fold"  # names of victims are long words
    for finding in report.findings:
        status = styled(finding.status, _COLOURS[finding.status])
        found = styled(finding.detail, "")
        if finding.remedy:  # a row in a pipe must stay one line
            space = "\n" if out.is_terminal else "  "
            found = Text.assemble(found, space, styled(f"→ {finding.remedy}", "bold"))
        rows.add_row(status, finding.check, found)
    out.print(rows)
    counts = Counter(finding.status for finding in report.findings)
    out.print(f"apil {report.version}: " + ", ".join(f"{status} {counts[status]}" for status in _COLOURS))
