"""Writes the tables of ``docs/fidelity.md`` from the rows that ``apil fidelity --out`` kept.

    python docs/make_fidelity.py [ROWS.jsonl]

The default is ``docs/results/fidelity.jsonl``. What stands between the two marker comments is replaced.
"""

from __future__ import annotations

import sys
from pathlib import Path

from apil_core.common.statistics import difference
from apil_core.evaluation.fidelity.rows import FidelityRow, Figure, read_rows
from apil_core.evaluation.results import Rate

HERE = Path(__file__).parent
PAGE = HERE / "fidelity.md"
BEGIN, END = "<!-- made by make_fidelity.py -->", "<!-- end of what make_fidelity.py made -->"


def pairing(row: FidelityRow) -> str:
    """``sumo-humans, v1 against v3``."""
    versions = [name.rpartition("/")[2] for name in (row.plan.adversary, row.plan.victim)]
    return f"{row.plan.env}, {' against '.join(versions)}"


def percent(rate: Rate) -> str:
    return f"{100 * rate.value:.1f} [{100 * rate.low:.1f}, {100 * rate.high:.1f}]"


def cells(figure: Figure) -> list[str]:
    published = "–" if figure.published is None else f"{figure.published:g}"
    return [percent(figure.measured), published, figure.verdict or "–"]


def main_table(rows: list[FidelityRow]) -> list[str]:
    lines = [
        "| pairing | actions | games | win % | published | difference | win+tie % | published | difference |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        who = f"{pairing(row)}{'*' if row.plan.stands_in_for else ''}"
        facts = [who, row.plan.setting, str(row.result.episodes), *cells(row.win), *cells(row.win_or_tie)]
        lines.append(f"| {' | '.join(facts)} |")
    return lines


def switch_table(rows: list[FidelityRow], default: FidelityRow) -> list[str]:
    """Switches of one game below its default row."""
    lines = ["| setting | games | win % | difference to published | win+tie % | difference to published "]
    lines[0] += "| win, difference to the first row | mean length |"
    lines.append("|---|---|---|---|---|---|---|---|")
    for row in [default, *rows]:
        result = row.result
        moved = difference(result.wins, result.episodes, default.result.wins, default.result.episodes)
        values = (100 * moved.value, 100 * moved.low, 100 * moved.high)
        cells = [
            row.plan.setting,
            str(result.episodes),
            percent(row.win.measured),
            row.win.verdict or "–",
            percent(row.win_or_tie.measured),
            row.win_or_tie.verdict or "–",
            "–" if row is default else "{:+.1f} [{:.1f}, {:.1f}]".format(*values),
            f"{result.mean_length:.0f}",
        ]
        lines.append(f"| {' | '.join(cells)} |")
    return lines


def endings_table(rows: list[FidelityRow]) -> list[str]:
    lines = ["| pairing | actions | how the games ended | mean length |", "|---|---|---|---|"]
    for row in rows:
        causes = sorted(row.result.causes.items(), key=lambda item: -item[1])
        endings = ", ".join(f"{name} {count}" for name, count in causes)
        lines.append(f"| {pairing(row)} | {row.plan.setting} | {endings} | {row.result.mean_length:.0f} |")
    return lines


def tables(rows: list[FidelityRow]) -> str:
    main = [row for row in rows if row.plan.kind in ("default", "as-published")]
    defaults = {pairing(row): row for row in main if row.plan.kind == "default"}
    parts = ["### Default and as published", "", *main_table(main)]
    for row in {row.plan.env: row for row in main if row.plan.stands_in_for}.values():
        parts += ["", f"\\* `{row.plan.adversary}` stands in for `{row.plan.stands_in_for}`."]
    parts += ["", "### How the games ended", "", *endings_table(main)]
    for name, default in defaults.items():
        same = [row for row in rows if pairing(row) == name and row is not default]
        if any(row not in main for row in same):
            parts += ["", f"### Switches of {name}", "", *switch_table(same, default)]
    versions = rows[0].result.versions
    seconds = sum(row.result.wall_seconds for row in rows)
    parts += [
        "",
        f"{sum(row.result.episodes for row in rows):,} games, seed {rows[0].plan.seed}, "
        f"{rows[0].plan.num_envs} in parallel, MuJoCo {versions['mujoco']}, torch {versions['torch']}; "
        f"{seconds / 60:.0f} minutes on 2 shared cores.",
    ]
    return "\n".join(parts)


def main() -> None:
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else HERE / "results" / "fidelity.jsonl"
    text = PAGE.read_text("utf-8")
    before, rest = text.split(BEGIN)
    _, after = rest.split(END)
    PAGE.write_text(f"{before}{BEGIN}\n\n{tables(read_rows(path))}\n\n{END}{after}", "utf-8")


if __name__ == "__main__":
    main()
