"""The page's summary sentences: best methods, claims, and the runs behind them."""

from __future__ import annotations

from collections import Counter

from apil_core.studies.bench.matrix import BASELINE
from apil_core.studies.report.models import ReportData
from apil_core.studies.report.statistics import compared
from apil_core.studies.report.table_models import Cell, Setting
from apil_core.studies.report.words import amount, percent, several


def bests(data: ReportData) -> list[str]:
    """One sentence for each game of table 1: the method with the highest win rate."""
    order = [setting.id for setting in data.settings]
    tables = sorted((t for t in data.tables if t.number == 1), key=lambda table: order.index(table.setting))
    return [text for table in tables[:1] for row in table.rows if (text := _best(row))]


def verdicts(data: ReportData) -> str:
    """Summary of the claims' verdicts; empty without claims."""
    found = Counter(claim.verdict for claim in data.claims)
    if not found:
        return ""
    return (
        f"Of {several(len(data.claims), 'claim')} of the paper, {found['holds']} held on these games, "
        f"{found['does not hold']} did not, and {found['cannot be told']} cannot be told."
    )


def facts(data: ReportData) -> list[tuple[str, str]]:
    """Name and value of each fact about the runs."""
    runs = data.provenance.runs
    cells = [cell for table in data.tables for cell in table.cells]
    episodes = sorted({score.episodes for cell in cells for score in cell.scores})
    replayed = [f"{cell.column} in {cell.game}: {cell.scores[0].source}" for cell in cells if cell.replayed]
    states = ", ".join(f"{n} {state}" for state, n in Counter(run.status for run in runs).most_common())
    missing = len(data.unfinished)
    rows = [
        ("games", ", ".join(data.games)),
        ("columns", ", ".join(data.columns)),
        ("seeds", ", ".join(str(seed) for seed in sorted({run.seed for run in runs}))),
        ("budget", ", ".join(dict.fromkeys(filter(None, map(_budget, data.settings))))),
        ("physics", ", ".join(sorted({run.physics for run in runs if run.physics}))),
        ("victims", "; ".join(dict.fromkeys(f"{run.game}: {run.victim}" for run in runs))),
        ("not trained here", "; ".join(dict.fromkeys(replayed))),
        ("games per score", ", ".join(f"{number:,}".replace(",", " ") for number in episodes)),
        ("runs", states + (f"; {several(missing, 'cell')} not finished" if missing else "")),
    ]
    return [(name, value) for name, value in rows if value]


def common_notes(data: ReportData) -> list[str]:
    """Notes that apply to the diagnostics of every run, each once."""
    notes = [set(diagnostic.notes) for diagnostic in data.diagnostics]
    shared = set.intersection(*notes) if notes else set()
    return [note for note in (data.diagnostics[0].notes if notes else []) if note in shared]


def _budget(setting: Setting) -> str:
    """A setting's budget relative to the published one."""
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
