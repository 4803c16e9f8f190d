"""Intervals are those of statsmodels, to rounding; by hand: test_evaluation.py, test_fidelity.py."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from apil_core.common.statistics import difference, mean_interval, wilson_interval

counts = st.integers(1, 5000).flatmap(lambda games: st.tuples(st.integers(0, games), st.just(games)))


@given(st.lists(counts, min_size=1, max_size=5))
def test_shares(pairs: list[tuple[int, int]]) -> None:
    from statsmodels.stats.proportion import proportion_confint  # slow to import

    wins, games = np.array(pairs).T
    low, high = wilson_interval(wins, games)
    expected = proportion_confint(wins, games, alpha=0.05, method="wilson")
    np.testing.assert_allclose([low, high], expected, rtol=1e-14, atol=1e-15)
    assert ((low >= 0) & (high <= 1)).all()


def test_shares_of_none_and_of_all_end_exactly() -> None:
    low, high = wilson_interval(np.array([0, 7]), np.array([7, 7]))
    assert (low[0], high[1]) == (0.0, 1.0)


@given(counts, counts)
def test_differences(one: tuple[int, int], base: tuple[int, int]) -> None:
    from statsmodels.stats.proportion import confint_proportions_2indep

    found = difference(*one, *base)
    low, high = confint_proportions_2indep(*one, *base, compare="diff", method="newcomb")
    assert (found.low, found.high) == pytest.approx((low, high), abs=1e-14)
    assert found.within_noise == (found.low <= 0 <= found.high)


@given(st.lists(st.floats(-1e3, 1e3), min_size=2, max_size=9))
def test_means(values: list[float]) -> None:
    from statsmodels.stats.weightstats import DescrStatsW

    expected = DescrStatsW(values).tconfint_mean()
    assert mean_interval(values) == pytest.approx(expected, rel=1e-9, abs=1e-9)
