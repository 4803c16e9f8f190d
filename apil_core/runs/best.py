"""Periodic evaluations of a run: the best checkpoint, and the conditions for stopping early."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from apil_core.api.config import StopConfig
from apil_core.evaluation.results import EvaluationResult


class EvaluationHistory:
    """The periodic evaluations of a run so far; stored in its checkpoints.

    Args:
        rows: of an earlier stretch, as :attr:`rows` had them.

    Attributes:
        rows: of each evaluation: environment steps, games, wins and the win rate's lower bound.
    """

    def __init__(self, rows: Iterable[dict[str, Any]] = ()):
        self.rows = list(rows)

    def add(self, result: EvaluationResult, steps: int) -> None:
        """Add an evaluation after ``steps`` environment steps."""
        low = result.win_rate.low
        self.rows.append({"steps": steps, "games": result.episodes, "wins": result.wins, "low": low})

    @property
    def best(self) -> dict[str, Any] | None:
        """The row with the highest win rate, the first of equals; ``None`` before the first evaluation."""
        return max(self.rows, key=_rate, default=None)

    def is_best(self, steps: int) -> bool:
        """True if the best evaluation is the one after ``steps`` environment steps."""
        return self.best is not None and self.best["steps"] == steps

    def why_stop(self, wanted: StopConfig) -> str:
        """Reason to stop after the last evaluation, or ``""``."""
        last, best = self.rows[-1], self.best
        assert best is not None
        if wanted.win_rate_above is not None and last["low"] > wanted.win_rate_above:
            return f"win rate {_rate(last):.1%} lies above {wanted.win_rate_above:.1%}, its interval too"
        since = len(self.rows) - 1 - self.rows.index(best)
        if wanted.no_gain_in is not None and since >= wanted.no_gain_in:
            return f"no gain in {since} evaluations over {_rate(best):.1%} at {best['steps']:,} steps"
        return ""


def _rate(row: dict[str, Any]) -> float:
    return float(row["wins"] / row["games"])
