"""The difference of two shares of games, with its interval."""

from __future__ import annotations

from pydantic import BaseModel


class Difference(BaseModel):
    """A base share subtracted from another, with Newcombe's 95 % interval, as fractions."""

    value: float
    low: float
    high: float
    within_noise: bool


def difference(count: int, games: int, base_count: int, base_games: int) -> Difference:
    """Difference ``count / games - base_count / base_games`` of two shares of independent games."""
    from statsmodels.stats.proportion import confint_proportions_2indep

    low, high = confint_proportions_2indep(
        count, games, base_count, base_games, compare="diff", method="newcomb", alpha=0.05
    )
    value = count / games - base_count / base_games
    return Difference(value=value, low=float(low), high=float(high), within_noise=bool(low <= 0 <= high))
