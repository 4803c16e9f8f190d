"""Puts a finished benchmark's report beside ``docs/quick-benchmark.md``, and its tables into that page.

    apil bench report runs/bench/quick runs/bench/matrix --run docs/results/long/kick-and-defend-adrl-s0 …
    python docs/make_quick.py runs/bench/quick

Copies the page (as ``report.html``), the CSV tables and the matrix into ``docs/results/quick/``. What stands
between the two marker comments of the page is replaced; all else is written by hand.
"""

from __future__ import annotations

import argparse
import shutil
from pathlib import Path

HERE = Path(__file__).parent
PAGE = HERE / "quick-benchmark.md"
KEPT = HERE / "results" / "quick"
BEGIN, END = "<!-- made by make_quick.py -->", "<!-- end of what make_quick.py made -->"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("bench", type=Path, help="directory of the benchmark, with its report")
    parser.add_argument("--report", type=Path, help="directory of the report, if elsewhere")
    flags = parser.parse_args()
    report = flags.report or flags.bench / "report"
    shutil.rmtree(KEPT, ignore_errors=True)
    (KEPT / "tables").mkdir(parents=True)
    shutil.copyfile(report / "index.html", KEPT / "report.html")
    shutil.copyfile(flags.bench / "matrix.yaml", KEPT / "matrix.yaml")
    for table in report.glob("tables/*.csv"):
        shutil.copyfile(table, KEPT / "tables" / table.name)
    before, _, rest = PAGE.read_text("utf-8").partition(BEGIN)
    _, _, after = rest.partition(END)
    PAGE.write_text(f"{before}{BEGIN}\n\n{tables(report)}\n{END}{after}", "utf-8")


def tables(report: Path) -> str:
    """The four tables in Markdown, each below its title, which names its setting."""
    parts = []
    for path in sorted(report.glob("tables/t?-*.md")):
        title, *lines = path.read_text("utf-8").splitlines()
        parts.append("\n".join([title, "", *(line for line in lines if line.startswith("|")), ""]))
    return "\n".join(parts)


if __name__ == "__main__":
    main()
