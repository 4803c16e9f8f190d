"""Puts a finished benchmark's report beside ``docs/quick-benchmark.md``, and its tables into that page.

    apil bench report runs/bench/quick runs/bench/matrix --run docs/results/long/kick-and-defend-adrl-s0 …
    python docs/make_quick.py runs/bench/quick

Copies the CSV tables and the matrix into ``docs/results/quick/``. What stands between the two marker comments
of the page is replaced; all else is written by hand.
"""

from __future__ import annotations

import argparse
import csv
import shutil
from pathlib import Path

HERE = Path(__file__).parent
PAGE = HERE / "quick-benchmark.md"
KEPT = HERE / "results" / "quick"
SIGNS = {"within noise": "≈", "higher": "↑", "lower": "↓"}
BEGIN, END = "<!-- made by make_quick.py -->", "<!-- end of what make_quick.py made -->"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("bench", type=Path, help="directory of the benchmark, with its report")
    parser.add_argument("--report", type=Path, help="directory of the report, if elsewhere")
    flags = parser.parse_args()
    report = flags.report or flags.bench / "report"
    shutil.rmtree(KEPT, ignore_errors=True)
    (KEPT / "tables").mkdir(parents=True)
    shutil.copyfile(flags.bench / "matrix.yaml", KEPT / "matrix.yaml")
    for table in report.glob("tables/*.csv"):
        shutil.copyfile(table, KEPT / "tables" / table.name)
    before, _, rest = PAGE.read_text("utf-8").partition(BEGIN)
    _, _, after = rest.partition(END)
    PAGE.write_text(f"{before}{BEGIN}\n\n{tables(report)}\n{END}{after}", "utf-8")


def tables(report: Path) -> str:
    """The four tables in Markdown, each below its number and setting."""
    return "\n".join(table(path) for path in sorted(report.glob("tables/t?-*.csv")))


def table(path: Path) -> str:
    """One table: two rows for each game, a column for each method."""
    rows = list(csv.DictReader(path.open(encoding="utf-8")))
    columns = list(dict.fromkeys(row["column"] for row in rows))
    cells = {(row["game"], row["share"], row["column"]): figure(row) for row in rows}
    blind = f", blinded: {rows[0]['blind']}" if rows[0]["blind"] else ""
    lines = [f"### Table {rows[0]['table']} ({rows[0]['setting']}{blind})", ""]
    lines += [line(["game", "share", *columns]), line(["---"] * (2 + len(columns)))]
    for game in dict.fromkeys(row["game"] for row in rows):
        for share, words in (("win", "win"), ("win_or_tie", "win+tie")):
            named = game if share == "win" else ""
            lines.append(line([named, words, *(cells[game, share, column] for column in columns)]))
    return "\n".join([*lines, ""])


def line(cells: list[str]) -> str:
    """One row in Markdown."""
    return f"| {' | '.join(cells)} |"


def figure(row: dict[str, str]) -> str:
    """``50.0 [47.8, 52.2] / 80 ↓``; a dash for what was not measured."""
    published = f" / {100 * float(row['published']):.0f}" if row["published"] else ""
    if not row["measured"]:
        return f"–{published}"
    value, low, high = (100 * float(row[name]) for name in ("measured", "low", "high"))
    return f"{value:.1f} [{low:.1f}, {high:.1f}]{published} {SIGNS.get(row['verdict'], '')}".rstrip()


if __name__ == "__main__":
    main()
