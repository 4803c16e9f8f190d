"""The paper's claims checked on its own tables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from apil_core.studies.report.published import published

MARGIN = 0.1
"""Largest loss that counts as none, where a claim says that nothing is lost: ten points."""

BASELINE = "baseline"

ORDER = ("adrl", "apl", "apil", "e_apil")
"""The paper's methods, weakest first by its claim."""

Metric = Literal["win", "win_or_tie"]
WORDS: dict[Metric, str] = {"win": "wins", "win_or_tie": "win+tie"}


def pairs_above(number: int, pairs: Sequence[tuple[str, str]], metric: Metric) -> str:
    """Count the cells of a table in which a column is above another, as a sentence."""
    table, place = published().tables[number], 0 if metric == "win" else 1
    rows = table.rows
    above = sum(row[a][place] > row[b][place] for row in rows.values() for a, b in pairs)
    below = [
        f"{a} {100 * row[a][place]:.0f} against {b} {100 * row[b][place]:.0f} in {game}"
        for game, row in rows.items()
        for a, b in pairs
        if row[a][place] < row[b][place]
    ]
    text = f"The paper's table {number} ({WORDS[metric]}): above in {above} of {len(rows) * len(pairs)}"
    return f"{text}; below: {', '.join(below)}." if below else f"{text}, never below."


def lost_when_blinded() -> str:
    """Columns that lose more than the margin of win+tie when blinded."""
    seeing, blind = published().tables[1].rows, published().tables[2].rows
    lost = [
        f"{method} {100 * seeing[game][method][1]:.0f} → {100 * blind[game][method][1]:.0f} in {game}"
        for game in seeing
        for method in published().columns
        if seeing[game][method][1] - blind[game][method][1] > MARGIN
    ]
    equal = [game for game in seeing if seeing[game] == blind[game]]
    points = f"{100 * MARGIN:.0f} points"
    text = f"The paper's tables 1 and 2 (win+tie): more than {points} lost by {', '.join(lost)}."
    if equal:
        text += f" In {', '.join(equal)} both rows are equal in every cell, as if nothing had been blinded."
    return text


def lost_when_retrained(number: int, metric: Metric) -> str:
    """Columns that lose more than the margin to the original victim."""
    table, place = published().tables[number], 0 if metric == "win" else 1
    lost = [
        f"{method} {100 * row[BASELINE][place]:.0f} → {100 * row[method][place]:.0f} in {game}"
        for game, row in table.rows.items()
        for method in ORDER
        if row[BASELINE][place] - row[method][place] > MARGIN
    ]
    text = f"The paper's table {number} ({WORDS[metric]}): more than {100 * MARGIN:.0f} points lost by"
    return f"{text} {', '.join(lost)}." if lost else f"{text} none."
