"""Shares over seeds, their differences, and means over games."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from apil_core.common.statistics import Difference, mean_interval, newcombe
from apil_core.evaluation.results import Rate, wilson
from apil_core.studies.report.table_models import Share, Verdict

ENOUGH_SEEDS = 3
"""Fewest seeds for statements on the spread over seeds."""

_RESAMPLES = 5000


def share(counts: Sequence[int], games: Sequence[int]) -> Share:
    """Share of games, mean over seeds.

    The interval covers the games of these agents (Wilson, all games together) below three seeds; from three
    on other seeds too: Student's t over the seeds' shares, or Wilson's where that reaches further, since
    seeds that happen to agree do not make their games more.

    Args:
        counts, games: one of each per seed, at least one; games are positive.
    """
    values = [count / total for count, total in zip(counts, games, strict=True)]
    pooled = wilson(sum(counts), sum(games))
    low, high = pooled.low, pooled.high
    if len(values) >= ENOUGH_SEEDS:
        seeds = mean_interval(values)
        low, high = max(0.0, min(low, seeds[0])), min(1.0, max(high, seeds[1]))
    mean = float(np.mean(values))
    return Share(
        value=mean,
        low=min(float(low), mean),  # of unequal numbers of games the mean can lie outside
        high=max(float(high), mean),
        interval="seeds" if len(values) >= ENOUGH_SEEDS else "games",
        sd=float(np.std(values, ddof=1)) if len(values) > 1 else None,
        minimum=min(values),
        maximum=max(values),
        per_seed=values,
    )


def compared(measured: Share | Rate, base: Share | Rate) -> Difference:
    """``measured - base`` with a 95 % interval combined from both intervals.

    Newcombe's construction: the distance of each share to its own limits, added in squares (for other
    intervals than Wilson's known as MOVER, Zou and Donner 2008). With Wilson's intervals it is exactly the
    interval of :func:`apil_core.common.statistics.difference`; with those over seeds it covers seeds as well.
    """
    return newcombe(measured.value, (measured.low, measured.high), base.value, (base.low, base.high))


def published_rate(fraction: float, games: int) -> Rate:
    """A published share with the interval for its number of games."""
    return wilson(round(fraction * games), games)


def verdict(difference: Difference) -> Verdict:
    """Sign of a difference, or that it is within noise."""
    if difference.within_noise:
        return "within noise"
    return "higher" if difference.value > 0 else "lower"


THRESHOLDS = [i / 100 for i in range(101)]
"""Scores at which performance profiles are given."""

Statistic = Callable[..., Any]
"""Of arrays (..., runs), one per game; returns (..., n), or (n,) of scalars."""


def interquartile_mean(*games: np.ndarray, axis: int = -1) -> np.ndarray:
    """Mean of the middle half of all runs' scores (25 % cut off at either end), Agarwal et al. 2021."""
    from scipy.stats import trim_mean

    return np.asarray(trim_mean(np.concatenate(games, axis=axis), 0.25, axis=axis))


def performance_profile(*games: np.ndarray, axis: int = -1) -> np.ndarray:
    """Share of runs with a score above each of :data:`THRESHOLDS`, mean over games (Agarwal et al. 2021).

    Returns:
        (thresholds, ...): the "run-score distribution".
    """
    return np.mean([[(scores > t).mean(axis) for t in THRESHOLDS] for scores in games], axis=0)


def probability_of_improvement(*games: np.ndarray, axis: int = -1) -> np.ndarray:
    """Probability that a run scores higher than one of another method in the same game, equal scores half.

    Mean over games of the Mann-Whitney statistic (Agarwal et al. 2021).

    Args:
        games: one method's scores in each game, then the other's in the same games.
        axis: of runs, the last.
    """
    pairs = zip(games[: len(games) // 2], games[len(games) // 2 :], strict=True)
    signs = [np.sign(own[..., :, None] - other[..., None, :]).mean((-2, -1)) for own, other in pairs]
    return 0.5 + 0.5 * np.mean(signs, axis=0)


def bootstrapped(
    statistic: Statistic, by_game: Sequence[Sequence[float]], seed: int = 0
) -> tuple[Any, Any, Any]:
    """Value of a statistic with its 95 % percentile bootstrap interval over seeds.

    Seeds are redrawn within each game, games are kept (Agarwal et al. 2021).

    Args:
        statistic: one of the above.
        by_game: scores of each game, one per run.
        seed: of the redrawing.

    Returns:
        Value, low, high, as numbers or lists; the latter two are ``None`` if a game has fewer than two runs.
    """
    from scipy.stats import bootstrap

    games = [np.asarray(scores) for scores in by_game]
    value = statistic(*games).tolist()
    if min(map(len, games)) < 2:
        return value, None, None
    drawn = bootstrap(
        games,
        statistic,
        n_resamples=_RESAMPLES,
        batch=1000,  # pairs of many runs would need gigabytes at once
        vectorized=True,
        method="percentile",
        rng=np.random.default_rng(seed),
    )
    low, high = drawn.confidence_interval
    return value, np.asarray(low).tolist(), np.asarray(high).tolist()
