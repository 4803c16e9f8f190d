"""The evidence as Markdown: each table, and a report in which everything can be read in order."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from apil_core.common.visible import visible
from apil_core.studies.report.models import Cell, Claim, Evidence, Figure, Setting, Table
from apil_core.studies.report.words import percent, several

SIGNS = {"within noise": "≈", "higher": "↑", "lower": "↓", "no published value": "", "not measured": ""}
LEGEND = (
    "Per cent of games, mean over seeds, with 95 % interval; behind it the published value: "
    "≈ the difference is within noise, ↑ higher, ↓ lower."
)


def markdown_table(evidence: Evidence, table: Table) -> str:
    """One table with its setting, its notes and its legend."""
    return _document(_table_lines(table, evidence.setting(table.setting)))


def _table_lines(table: Table, setting: Setting) -> Iterator[str]:
    yield f"### Table {table.number}: {table.title} ({setting.label}{_blind(table)})"
    yield ""
    if setting.budget:
        yield f"**{setting.budget} of the published budget.**"
        yield ""
    for note in setting.notes:
        yield f"- {note}"
    yield from ("", f"{LEGEND} Wins are the {table.side}'s.", "")
    yield _row(["game", "share", *table.columns])
    yield _row(["---"] * (2 + len(table.columns)))
    for cells in table.rows:
        yield _row([cells[0].game, "win", *(figure_text(cell, cell.win) for cell in cells)])
        yield _row(["", "win+tie", *(figure_text(cell, cell.win_or_tie) for cell in cells)])


def _blind(table: Table) -> str:
    return f", blinded: {table.blind}" if table.blind else ""


def _row(texts: Sequence[str]) -> str:
    return f"| {' | '.join(text.replace('|', chr(92) + '|') for text in texts)} |"


def figure_text(cell: Cell, figure: Figure) -> str:
    """``50.0 [47.8, 52.2] (2 seeds, sd 1.4) / 80 ↓``; a dash for what was not measured."""
    published = "" if figure.published is None else f" / {100 * figure.published:.0f}"
    measured = figure.measured
    if measured is None:
        return f"–{published}"
    spread = "" if measured.sd is None else f", sd {percent(measured.sd)}"
    seeds = f" ({several(cell.seeds, 'seed')}{spread})" if cell.seeds > 1 else ""
    interval = f"[{percent(measured.low)}, {percent(measured.high)}]"
    return f"{percent(measured.value)} {interval}{seeds}{published} {SIGNS[figure.verdict]}".rstrip()


def markdown_report(evidence: Evidence) -> str:
    """Warnings, tables, claims, method against method, endings, what is missing, where it comes from."""
    return _document(_report_lines(evidence))


def _document(lines: Iterable[str]) -> str:
    """The lines, in which names and reasons are text: no HTML, no link."""
    text = visible("".join(f"{' '.join(line.splitlines())}\n" for line in lines))
    return text.replace("<", "&lt;").replace("](", "]\\(")


def _report_lines(evidence: Evidence) -> Iterator[str]:
    yield from (f"# {evidence.title}", "")
    yield from _section("Read this first", [f"- {w.text}" for w in evidence.warnings if w.loud])
    yield from ("## Tables", "")
    for table in evidence.tables:
        yield from (*_table_lines(table, evidence.setting(table.setting)), "")
    claims = [line for claim in evidence.claims for line in _claim_lines(claim, evidence)]
    yield from _section("Claims of the paper, on these games", claims)
    yield from _section("Methods against each other", _difference_lines(evidence))
    yield from _section("Over all games", _aggregate_lines(evidence))
    yield from _section("What a single setting does", _ablation_lines(evidence))
    yield from _section("How games ended", _ending_lines(evidence))
    yield from _section("Also mind", [f"- {w.text}" for w in evidence.warnings if not w.loud])
    missing = [f"- {e.game}, {e.method}, {e.label}: {e.status}, {e.reason}" for e in evidence.unfinished]
    yield from _section("Not finished", missing)
    yield from _section("Where it comes from", _provenance_lines(evidence))


def _section(title: str, lines: Sequence[str]) -> Iterator[str]:
    if lines:
        yield from (f"## {title}", "", *lines, "")


def _claim_lines(claim: Claim, evidence: Evidence) -> list[str]:
    label = evidence.setting(claim.setting).label
    return [
        f"**{claim.claim}** {claim.verdict.capitalize()} ({label}). {claim.text} {claim.published}",
        "",
        *(f"- {check.game}: {check.verdict}. {check.text}" for check in claim.checks),
        "",
    ]


def _difference_lines(evidence: Evidence) -> list[str]:
    lines = [
        "In points, with 95 % intervals. Of twenty comparisons one differs by chance.",
        "",
        _row(["table", "game", "methods", "win", "", "win+tie", ""]),
        _row(["---"] * 7),
    ]
    rows = [
        _row(
            [
                each.table,
                each.game,
                f"{each.column} − {each.base}",
                *(f"{100 * d.value:+.1f} [{100 * d.low:.1f}, {100 * d.high:.1f}]", str(win)),
                *(f"{100 * e.value:+.1f} [{100 * e.low:.1f}, {100 * e.high:.1f}]", str(either)),
            ]
        )
        for each in evidence.differences
        for d, e in [(each.win, each.win_or_tie)]
        for win, either in [(each.win_verdict, each.win_or_tie_verdict)]
    ]
    return [*lines, *rows] if rows else []


def _aggregate_lines(evidence: Evidence) -> list[str]:
    rows = [
        _row(
            [
                evidence.setting(each.setting).label,
                each.column,
                {"win": "win", "win_or_tie": "win+tie"}[each.metric],
                percent(each.iqm),
                "–"
                if each.low is None or each.high is None
                else f"[{percent(each.low)}, {percent(each.high)}]",
                each.note,
            ]
        )
        for each in evidence.aggregates
    ]
    head = [_row(["setting", "method", "share", "interquartile mean", "interval", "note"]), _row(["---"] * 6)]
    return [*head, *rows] if rows else []


def _ablation_lines(evidence: Evidence) -> list[str]:
    rows = [
        _row(
            [
                f"{ablation.axis}={row.value}",
                ablation.game,
                ablation.method,
                figure_text(row.cell, row.cell.win),
                figure_text(row.cell, row.cell.win_or_tie),
                str(row.win_or_tie_verdict or "the default"),
            ]
        )
        for ablation in evidence.ablations
        for row in ablation.rows
    ]
    head = [
        _row(["setting", "game", "method", "win", "win+tie", "win+tie beside the default"]),
        _row(["---"] * 6),
    ]
    return [*head, *rows] if rows else []


def _ending_lines(evidence: Evidence) -> list[str]:
    rows = [
        _row(
            [
                each.table,
                each.game,
                each.column,
                f"{each.wins} / {each.ties} / {each.losses}",
                ", ".join(f"{name} {count}" for name, count in each.causes.items()),
                f"{each.mean_length:.0f}",
            ]
        )
        for each in evidence.endings
    ]
    head = [
        _row(["table", "game", "method", "win / tie / loss", "endings", "mean length"]),
        _row(["---"] * 6),
    ]
    return [*head, *rows] if rows else []


def _provenance_lines(evidence: Evidence) -> list[str]:
    own = evidence.provenance
    versions = ", ".join(f"{name} {' or '.join(found)}" for name, found in own.versions.items())
    return [
        f"- Directories: {', '.join(own.directories)}",
        f"- {several(len(own.runs), 'run')}, {own.hours:.1f} hours of training, {own.steps:,} steps",
        f"- Versions: {versions}",
        f"- Code: {', '.join(own.git) or 'unknown'}; machines: {', '.join(own.hosts) or 'unknown'}",
        f"- Written {own.written} by apil {own.apil}",
    ]
