"""The paper's claims, checked on these games: ``holds``, ``does not hold`` or ``cannot be told``.

Rules: a claim holds only on differences beyond noise; an ordering of methods needs several seeds; below the
published budget a failing claim counts as undecided.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import pairwise
from typing import NamedTuple

from apil_core.common.statistics import Difference
from apil_core.studies.bench.matrix import BASELINE
from apil_core.studies.report.models import Check, Claim, Truth
from apil_core.studies.report.paper_claims import IN_THE_PAPER, MARGIN, ORDER, WORDS
from apil_core.studies.report.published import published
from apil_core.studies.report.retrained_tables import STRONGEST
from apil_core.studies.report.statistics import ENOUGH_SEEDS, compared
from apil_core.studies.report.table_models import Cell, Metric, Setting, Share, Table
from apil_core.studies.report.words import budget_mark, percent, several

_HOLDS: Truth = "holds"
_FAILS: Truth = "does not hold"
_OPEN: Truth = "cannot be told"

_ORDERS: dict[Metric, str] = {"win_or_tie": "order", "win": "order on wins"}
"""Names of the claim on the order of methods, by measure."""


class _Finding(NamedTuple):
    """One comparison: its verdict on the claim, and the text for it."""

    verdict: Truth
    text: str


def claims(tables: Sequence[Table], settings: Sequence[Setting]) -> list[Claim]:
    """All claims in every setting whose tables have data on them."""
    lost = f"they lose no more than {100 * MARGIN:.0f} points of"
    found = []
    for setting in settings:
        if setting.changes_method or (setting.steps is None and setting.retrain_steps is None):
            continue  # an ablation's, or no run's: no method of the paper
        own = [table for table in tables if table.setting == setting.id]
        for seeing in (table for table in own if table.number == 1):
            text = "Every adversarial method beats the baseline adversary (win+tie)."
            found.append(_claim("beats baseline", text, seeing, setting, _beats))
            for metric, name in _ORDERS.items():
                text, finding = f"E-APIL ≥ APIL ≥ APL ≥ ADRL on {WORDS[metric]}.", partial(_order, metric)
                found.append(_claim(name, text, seeing, setting, finding))
            for table in (table for table in own if table.number == 2):
                name = "blinding" if table.blind == "zeros" else f"blinding ({table.blind})"
                text = (
                    f"Adversaries do not need to see their opponent: blinded ({table.blind}), {lost} win+tie."
                )
                found.append(_claim(name, text, table, setting, partial(_blinded, seeing)))
        for table in (table for table in own if table.number == 4):
            text = "The victim retrained against E-APIL's adversary wins more against it than the original "
            found.append(_claim("resists", f"{text}victim does.", table, setting, _resists, (STRONGEST,)))
        for table in (table for table in own if table.number == 3):
            text = f"Retrained victims do not forget the baseline adversary: {lost} wins against it."
            found.append(_claim("remembers", text, table, setting, _remembers))
    return [claim for claim in found if claim.checks]


def _beats(row: Sequence[Cell]) -> Iterator[_Finding]:
    if _cell(row, BASELINE) is None:
        yield _Finding(_OPEN, "the baseline adversary was not measured")
    else:
        for method in _trained(row):
            yield _more(row, method, BASELINE, "win_or_tie")


def _order(metric: Metric, row: Sequence[Cell]) -> Iterator[_Finding]:
    present = [name for name in ORDER if _cell(row, name) is not None]
    for weaker, stronger in pairwise(present):
        yield _needing_seeds(row, (weaker, stronger), _more(row, stronger, weaker, metric))


def _blinded(seeing: Table, row: Sequence[Cell]) -> Iterator[_Finding]:
    before = {each.column: each for other in seeing.rows for each in other if each.game == row[0].game}
    for method in _trained(row):
        yield from _kept(method, _cell(row, method), before.get(method), "win_or_tie")


def _resists(row: Sequence[Cell]) -> Iterator[_Finding]:
    if _cell(row, STRONGEST) is not None:
        yield _more(row, STRONGEST, BASELINE, "win", "retrained against e_apil", "the original victim")


def _remembers(row: Sequence[Cell]) -> Iterator[_Finding]:
    for method in _trained(row):
        yield from _kept(f"retrained against {method}", _cell(row, method), _cell(row, BASELINE), "win")


def _claim(
    name: str,
    claim: str,
    table: Table,
    setting: Setting,
    findings: Callable[[Sequence[Cell]], Iterator[_Finding]],
    needs: Sequence[str] = ORDER,
) -> Claim:
    """Make a claim with its checks; it concerns all games of the paper and the methods it ``needs``."""
    checks = []
    for row in (row for row in table.rows if row[0].game in published().games):
        found = list(findings(row))
        if found:
            missing = [method for method in needs if _cell(row, method) is None]
            if missing:
                found.append(_Finding(_OPEN, f"{', '.join(missing)} not measured"))
            verdict = _together([finding.verdict for finding in found])
            if verdict == _FAILS and _short(setting):
                verdict = _OPEN
            text = "; ".join(finding.text for finding in found) + "."
            checks.append(Check(game=row[0].game, verdict=verdict, text=text))
    games = {check.game for check in checks}
    absent = [game for game in published().games if game not in games]
    return Claim(
        id=name,
        claim=claim,
        published=IN_THE_PAPER[name.partition(" (")[0]],
        setting=setting.id,
        verdict=_together([*(check.verdict for check in checks), *(_OPEN for _ in absent)]),
        text=_summary(checks, absent, table, setting),
        checks=checks,
    )


def _together(verdicts: Sequence[Truth]) -> Truth:
    """Combine findings: all must hold; one failure is enough to fail."""
    if _FAILS in verdicts:
        return _FAILS
    return _HOLDS if verdicts and set(verdicts) == {_HOLDS} else _OPEN


def _short(setting: Setting) -> str:
    """Describe how the budget falls short of the published one; ``""`` if it does not."""
    marks = dict.fromkeys([setting.budget, budget_mark(setting.steps, published().adversary_steps)])
    return " and ".join(filter(None, marks)) or ("an unknown budget" if setting.steps is None else "")


def _summary(checks: Sequence[Check], absent: Sequence[str], table: Table, setting: Setting) -> str:
    counts = {
        verdict: [c.game for c in checks if c.verdict == verdict] for verdict in (_HOLDS, _FAILS, _OPEN)
    }
    parts = [f"{verdict} in {', '.join(games)}" for verdict, games in counts.items() if games]
    text = "; ".join(parts)[:1].upper() + "; ".join(parts)[1:] + "."
    if absent:
        text += f" Not measured: {', '.join(absent)}."
    if short := _short(setting):
        seen = f"Seen at {short} of the budget." if len(counts[_HOLDS]) == len(checks) else ""
        text += f" {seen or f'At this budget ({short}) what does not show is not refuted.'}"
    seeds = [cell.seeds for cell in table.cells if cell.column != BASELINE and not cell.replayed]
    if seeds and min(seeds) < ENOUGH_SEEDS:
        text += f" Of these agents only ({several(min(seeds), 'seed')}): other seeds may differ."
    return text


def _trained(row: Sequence[Cell]) -> list[str]:
    """The measured methods of the paper; its claims concern no others."""
    return [each.column for each in row if each.scores and each.column in ORDER]


def _cell(row: Sequence[Cell], column: str) -> Cell | None:
    return next((each for each in row if each.column == column and each.scores), None)


def _share(cell: Cell | None, metric: Metric) -> Share | None:
    return cell.share(metric) if cell else None


def _more(
    row: Sequence[Cell], column: str, base: str, metric: Metric, name: str = "", base_name: str = ""
) -> _Finding:
    """Check that a column is above another, beyond noise."""
    own, other = _share(_cell(row, column), metric), _share(_cell(row, base), metric)
    name, base_name = name or column, base_name or base
    if own is None or other is None:
        return _Finding(_OPEN, f"{base_name if other is None else name} was not measured")
    difference = compared(own, other)
    verdict = _OPEN if difference.within_noise else _HOLDS if difference.value > 0 else _FAILS
    shares = f"{percent(own.value)} % {WORDS[metric]} against {base_name} {percent(other.value)} %"
    return _Finding(verdict, f"{name} {shares}, {_points(difference)}")


def _needing_seeds(row: Sequence[Cell], columns: Sequence[str], finding: _Finding) -> _Finding:
    seeds = min(found.seeds for name in columns if (found := _cell(row, name)) is not None)
    if seeds >= ENOUGH_SEEDS or finding.verdict == _OPEN:
        return finding
    return _Finding(_OPEN, f"{finding.text}, but of {several(seeds, 'seed')} each")


def _kept(name: str, after: Cell | None, before: Cell | None, metric: Metric) -> Iterator[_Finding]:
    """Check that no more than the margin was lost: confirmed, refuted, or undecided."""
    own, base = _share(after, metric), _share(before, metric)
    if own is None or base is None:
        return
    text, difference = f"{name} {percent(base.value)} → {percent(own.value)} %", compared(own, base)
    if base.high < MARGIN:
        yield _Finding(_OPEN, f"{text}, too little to lose any")
        return
    verdict = _HOLDS if difference.low >= -MARGIN else _FAILS if difference.high < -MARGIN else _OPEN
    yield _Finding(verdict, f"{text}, {_points(difference)}")


def _points(difference: Difference) -> str:
    value, low, high = (100 * x for x in (difference.value, difference.low, difference.high))
    noise = ", within noise" if difference.within_noise else ""
    return f"{value:+.1f} points [{low:.1f}, {high:.1f}]{noise}"
