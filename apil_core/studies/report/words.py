"""Number formats shared by tables, warnings and the page."""

from __future__ import annotations

MEASURES = {"win": "win", "win_or_tie": "win or tie", "return": "return", "imitator": "imitator’s error"}
"""Names of the lines of learning curves, and of shares, on the page."""


def amount(steps: int) -> str:
    """``35 M``, ``1.5 M``, ``300 k`` or ``512``."""
    for size, unit in ((10**6, " M"), (10**3, " k")):
        if steps >= 0.9995 * size:  # what rounds up to it
            number = steps / size
            return f"{number:.3g}{unit}" if number < 999.5 else f"{number:.0f}{unit}"
    return str(steps)


def percent(share: float) -> str:
    """Format a fraction in per cent with one decimal: ``29.0``."""
    return f"{100 * share:.1f}"


def budget_mark(steps: int | None, published: int | None) -> str:
    """``"1 M of 35 M = 2.9 %"``; empty for the full budget or an unknown one."""
    if steps is None or published is None or steps >= published:
        return ""
    share = 100 * steps / published
    words = f"{share:.2g}" if share < 99 else f"{min(share, 99.9):.1f}"  # never a whole one
    return f"{amount(steps)} of {amount(published)} = {words} %"


def several(count: int, thing: str) -> str:
    """``1 seed``, ``3 seeds``."""
    return f"{count} {thing}" if count == 1 else f"{count} {thing}s"
