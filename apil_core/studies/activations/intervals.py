"""Intervals over games: steps within a game are dependent, so whole games are resampled."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from apil_core.studies.activations.models import Gap

Array = NDArray[np.float64]

RESAMPLES = 9999


def mean_interval(games: Array, seed: int) -> tuple[float, float]:
    """95 % interval of the mean of ``games`` (n,), one value per game; BCa bootstrap."""
    if np.ptp(games) == 0:
        return float(games[0]), float(games[0])
    return _bootstrap((games,), np.mean, seed)


def gap(games: Array, base: Array, seed: int) -> Gap:
    """Mean of ``games`` minus mean of ``base``, both (n,), each resampled independently."""
    value = float(games.mean() - base.mean())
    if np.ptp(games) == 0 and np.ptp(base) == 0:
        return Gap(value=value, low=value, high=value)
    low, high = _bootstrap((games, base), _difference, seed)
    return Gap(value=value, low=low, high=high)


def _difference(games: Array, base: Array, axis: int) -> Array:
    found: Array = games.mean(axis=axis) - base.mean(axis=axis)
    return found


def _bootstrap(samples: tuple[Array, ...], statistic: Callable[..., Array], seed: int) -> tuple[float, float]:
    from scipy.stats import bootstrap

    for method in ("BCa", "percentile"):  # BCa is undefined where nearly all games are equal
        found = bootstrap(
            samples,
            statistic,
            n_resamples=RESAMPLES,
            batch=1000,
            method=method,
            rng=np.random.default_rng(seed),
        ).confidence_interval
        if np.isfinite([found.low, found.high]).all():
            break
    return float(found.low), float(found.high)
