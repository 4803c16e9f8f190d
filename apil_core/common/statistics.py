"""95 % intervals of shares of games, of their differences, and of means."""

from __future__ import annotations

from collections.abc import Sequence
from math import hypot

import numpy as np
from pydantic import BaseModel

_Z = 1.9599639845400545
"""Of the normal distribution, 2.5 % beyond."""


class Difference(BaseModel):
    """A base share subtracted from another, with Newcombe's 95 % interval, as fractions."""

    value: float
    low: float
    high: float
    within_noise: bool


def wilson_interval(counts: np.ndarray | int, games: np.ndarray | int) -> tuple[np.ndarray, np.ndarray]:
    """Wilson's score interval of ``counts / games``: low and high ends of that shape, fractions."""
    counts, games = np.asarray(counts, float), np.asarray(games, float)
    share, weight = counts / games, 1 + _Z**2 / games
    centre = (share + _Z**2 / (2 * games)) / weight
    distance = _Z * np.sqrt(share * (1 - share) / games + _Z**2 / (4 * games**2)) / weight
    # rounding leaves 4e-18 where the interval starts at 0
    low, high = np.where(counts == 0, 0.0, centre - distance), centre + distance
    return low, np.where(counts == games, 1.0, high)


def newcombe(
    value: float, interval: Sequence[float], base: float, base_interval: Sequence[float]
) -> Difference:
    """``value - base`` with an interval made of both intervals.

    The distance of each share to its own limits, added in squares: Newcombe's if they are Wilson's, for
    others known as MOVER (Zou and Donner 2008).
    """
    low = value - base - hypot(value - interval[0], base_interval[1] - base)
    high = value - base + hypot(interval[1] - value, base - base_interval[0])
    return Difference(value=value - base, low=low, high=high, within_noise=low <= 0 <= high)


def difference(count: int, games: int, base_count: int, base_games: int) -> Difference:
    """Difference ``count / games - base_count / base_games`` of two shares of independent games."""
    low, high = wilson_interval(np.array([count, base_count]), np.array([games, base_games]))
    return newcombe(count / games, (low[0], high[0]), base_count / base_games, (low[1], high[1]))


def mean_interval(values: Sequence[float] | np.ndarray) -> tuple[float, float]:
    """Interval of a mean by Student's t, of at least two values."""
    from scipy.stats import t

    reach = t.ppf(0.975, len(values) - 1) * np.std(values, ddof=1) / np.sqrt(len(values))
    return float(np.mean(values) - reach), float(np.mean(values) + reach)
