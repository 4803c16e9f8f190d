"""One row of metrics from those of several processes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

_SUMMED = ("games", "games_total")
_SUMMED_GROUPS = ("window_", "cause/")
_PER_GAME = ("return/", "episode_length")


def merged(rows: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Counts of games are added, means over ended games weighted by their number, all others averaged.

    Args:
        rows: one per process; what is not in a row does not count there.
    """
    keys = dict.fromkeys(key for row in rows for key in row)
    return {key: _merged(key, [row for row in rows if key in row]) for key in keys}


def _merged(key: str, rows: Sequence[Mapping[str, float]]) -> float:
    values = [row[key] for row in rows]
    if key in _SUMMED or key.startswith(_SUMMED_GROUPS):
        return sum(values)
    weights = [row["games"] if key.startswith(_PER_GAME) else 1 for row in rows]
    return sum(value * weight for value, weight in zip(values, weights, strict=True)) / sum(weights)
