"""What stands above all numbers of the page: a plain summary, what was run, and what to be loud about."""

from __future__ import annotations

from collections import Counter

from apil_core.studies.report.figures.palette import BASELINE
from apil_core.studies.report.models import Cell, Evidence, Setting, Table
from apil_core.studies.report.statistics import compared
from apil_core.studies.report.words import amount, percent, several


def bests(evidence: Evidence) -> list[str]:
    """Table 1 in a sentence for each game: who won most often."""
    table = first_table(evidence, 1)
    return [text for row in table.rows if (text := _best(row))] if table is not None else []


def verdicts(evidence: Evidence) -> str:
    """How the paper's claims fared, or nothing."""
    found = Counter(claim.verdict for claim in evidence.claims)
    if not found:
        return ""
    return (
        f"Of {several(len(evidence.claims), 'claim')} of the paper, {found['holds']} held on these games, "
        f"{found['does not hold']} did not, and {found['cannot be told']} cannot be told."
    )


def facts(evidence: Evidence) -> list[tuple[str, str]]:
    """Name and value of what was run."""
    runs = evidence.provenance.runs
    cells = [cell for table in evidence.tables for row in table.rows for cell in row]
    episodes = sorted({score.episodes for cell in cells for score in cell.scores})
    rows = [
        ("games", ", ".join(evidence.games)),
        ("columns", ", ".join(evidence.columns)),
        ("seeds", _some([str(seed) for seed in sorted({run.seed for run in runs})])),
        ("budget", _some(_budgets(evidence))),
        ("physics", _some(sorted({run.physics for run in runs if run.physics}))),
        ("victims", _some(list(dict.fromkeys(f"{run.game}: {run.victim}" for run in runs)), "; ")),
        ("games per score", _some([f"{number:,}".replace(",", " ") for number in episodes])),
        ("runs", _states(evidence)),
    ]
    return [(name, value) for name, value in rows if value]


def loud(evidence: Evidence) -> list[str]:
    """Why these numbers are weaker than the paper's: loud warnings, else the settings' notes, each once."""
    warnings = [warning.text for warning in evidence.warnings if warning.loud]
    notes = [note for setting in evidence.settings for note in setting.notes]
    return list(dict.fromkeys(warnings or notes))


def common_notes(evidence: Evidence) -> list[str]:
    """What is to be said of the diagnostics of every run, once."""
    notes = [set(diagnostic.notes) for diagnostic in evidence.diagnostics]
    shared = set.intersection(*notes) if notes else set()
    return [note for note in (evidence.diagnostics[0].notes if notes else []) if note in shared]


def first_table(evidence: Evidence, number: int) -> Table | None:
    """That table in the first setting that has it."""
    order = [setting.id for setting in evidence.settings]
    tables = [table for table in evidence.tables if table.number == number]
    return min(tables, key=lambda table: order.index(table.setting), default=None)


def budget(setting: Setting) -> str:
    """A setting's budget beside the published one."""
    own = setting.retrain_steps if setting.retrain_steps is not None else setting.steps
    return setting.budget or (f"{amount(own)} steps" if own else "")


def _best(row: list[Cell]) -> str:
    measured = [(cell.column, share) for cell in row if (share := cell.win.measured) is not None]
    trained = [pair for pair in measured if pair[0] != BASELINE]
    if not trained:
        return ""
    name, best = max(trained, key=lambda pair: pair[1].value)
    tie = next(cell.win_or_tie.measured for cell in row if cell.column == name)
    equals = [other for other, share in trained if other != name and compared(best, share).within_noise]
    text = f"{row[0].game}: {name} won most often, {percent(best.value)} %"
    text += f" (with ties {percent(tie.value)} %)" if tie is not None else ""
    text += f", within noise of {' and '.join(equals)}" if equals else ""
    base = dict(measured).get(BASELINE)
    if base is None:
        return f"{text}. The baseline adversary was not scored."
    noise = ", within noise of it" if compared(best, base).within_noise else ""
    return f"{text}. Baseline adversary: {percent(base.value)} %{noise}."


def _budgets(evidence: Evidence) -> list[str]:
    return list(dict.fromkeys(text for setting in evidence.settings if (text := budget(setting))))


def _states(evidence: Evidence) -> str:
    states = Counter(run.status for run in evidence.provenance.runs)
    told = [f"{count} {state}" for state, count in states.most_common()]
    missing = len(evidence.unfinished)
    return ", ".join(told) + (f"; {several(missing, 'cell')} not finished" if missing else "")


def _some(values: list[str], separator: str = ", ") -> str:
    return separator.join(values)
