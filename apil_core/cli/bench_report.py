"""``apil bench report``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from apil_core.cli.flags import Json
from apil_core.cli.output import console, print_json
from apil_core.common.extras import need
from apil_core.common.files import check_free

PAGE, TABLES = "index.html", "tables"


def report(
    directories: Annotated[
        list[Path],
        Parameter(
            name="DIR",
            help="Benchmarks, finished or not; runs, and JSON files of apil eval and crossplay, too.",
        ),
    ],
    /,
    *,
    run: Annotated[
        list[Path], Parameter(help="A further single run; repeatable.", show_default=False, metavar="DIR")
    ] = [],  # noqa: B006 - cyclopts reads it, it is never mutated
    out: Annotated[
        Path | None,
        Parameter(
            help="Where to write [default: report in the first, or beside a file].", show_default=False
        ),
    ] = None,
    tables_only: Annotated[bool, Parameter(help="No page, only the tables.", show_default=False)] = False,
    force: Annotated[bool, Parameter(help="Replace a report in --out.", show_default=False)] = False,
    json: Json = False,
) -> int:
    """Compare a benchmark's results with the published ones: one page, and tables as CSV and LaTeX.

    Available results are shown; missing, weak or incomparable ones are marked as such.
    """
    from apil_core.studies.report.report_data import gather
    from apil_core.studies.report.tables import write_tables

    if not tables_only:
        need("matplotlib")
    for path in () if out is None else (out / PAGE, out / TABLES):
        check_free(path, force=force)
    data = gather(directories, run)
    first = directories[0]
    folder = out if out is not None else (first.parent if first.is_file() else first) / "report"
    written = write_tables(data, folder / TABLES)
    page = None
    if not tables_only:
        from apil_core.studies.report.page import write_page

        page = folder / PAGE
        write_page(data, page)
    if json:
        kept = data.model_dump(mode="json", include={"title", "settings", "claims", "warnings", "unfinished"})
        print_json({"page": page and str(page), "tables": [str(path) for path in written], **kept})
        return 0
    to = console()
    for claim in data.claims:
        label = data.setting(claim.setting).label
        to.print(f"{claim.verdict:15} {claim.claim} ({label})")
    for warning in data.warnings:
        if warning.loud:
            to.print(f"warning: {warning.text}")
    to.print(f"tables  {folder / TABLES} ({len(written)} files)")
    if page is not None:
        to.print(f"page    {page}")
    return 0
