"""Shares over seeds and their differences, against hand arithmetic."""

from __future__ import annotations

import numpy as np
import pytest

from apil_core.common.statistics import difference
from apil_core.evaluation.results import wilson
from apil_core.studies.report.statistics import (
    bootstrapped,
    compared,
    interquartile_mean,
    performance_profile,
    probability_of_improvement,
    published_rate,
    share,
    verdict,
)


def test_one_seed_has_wilsons_interval_and_no_spread() -> None:
    own = share([480], [1000])
    rate = wilson(480, 1000)
    assert (own.value, own.low, own.high, own.sd) == (0.48, rate.low, rate.high, None)
    assert own.interval == "games"


def test_two_seeds_tell_their_games_only() -> None:
    """80 and 20 of 100: mean 50 %, Wilson of 100 in 200, sd 60/√2 points."""
    own = share([80, 20], [100, 100])
    rate = wilson(100, 200)
    assert (own.value, own.low, own.high, own.interval) == (0.5, rate.low, rate.high, "games")
    assert own.sd == pytest.approx(0.6 / 2**0.5)
    assert (own.minimum, own.maximum) == (0.2, 0.8)


def test_three_seeds_have_students_interval() -> None:
    """0.4, 0.5, 0.6: sd 0.1, half width t(0.975; 2) · 0.1/√3 = 4.302653 · 0.057735 = 0.248414."""
    own = share([400, 500, 600], [1000] * 3)
    assert own.interval == "seeds"
    assert own.low == pytest.approx(0.5 - 0.248414, abs=1e-6)
    assert own.high == pytest.approx(0.5 + 0.248414, abs=1e-6)


def test_seeds_that_agree_do_not_make_their_games_more() -> None:
    for count in (0, 50):
        own, rate = share([count] * 3, [100] * 3), wilson(3 * count, 300)
        assert (own.low, own.high, own.sd) == (rate.low, rate.high, 0.0)
        assert own.high > own.value


def test_an_interval_over_seeds_stays_a_share() -> None:
    own = share([0, 10, 1000], [1000] * 3)
    assert (own.low, own.high) == (0.0, pytest.approx(1.0))


def test_unequal_numbers_of_games_leave_the_mean_inside() -> None:
    """10 of 10 and 0 of 1000: the mean of the shares is 50 %, far above the pooled 1 %."""
    own = share([10, 0], [10, 1000])
    assert own.low <= own.value <= own.high == 0.5


@pytest.mark.parametrize(
    "counts", [(700, 1000, 480, 1000), (0, 50, 3, 40), (10, 10, 10, 10), (0, 1000, 0, 1000)]
)
def test_the_difference_of_wilson_shares_is_newcombes(counts: tuple[int, int, int, int]) -> None:
    a, n, b, m = counts
    mine, theirs = compared(wilson(a, n), wilson(b, m)), difference(a, n, b, m)
    assert mine.value == pytest.approx(theirs.value)
    assert (mine.low, mine.high) == (pytest.approx(theirs.low), pytest.approx(theirs.high))
    assert mine.within_noise == theirs.within_noise


def test_the_difference_of_seeds_is_wider() -> None:
    """Both half widths 0.248414: √2 times that to either side."""
    one, other = share([400, 500, 600], [1000] * 3), share([200, 300, 400], [1000] * 3)
    found = compared(one, other)
    assert found.value == pytest.approx(0.2)
    assert found.low == pytest.approx(0.2 - 2**0.5 * 0.248414, abs=1e-5)
    assert verdict(found) == "within noise"
    assert verdict(compared(wilson(1500, 3000), wilson(900, 3000))) == "higher"
    assert verdict(compared(wilson(900, 3000), wilson(1500, 3000))) == "lower"


def test_a_published_share_has_the_noise_of_its_games() -> None:
    assert published_rate(0.29, 1000) == wilson(290, 1000)


def test_the_interquartile_mean_is_that_of_the_middle_half() -> None:
    """Of eight numbers the two smallest and the two largest do not count: (2+3+4+5)/4."""
    value, low, high = bootstrapped(interquartile_mean, [[0, 1, 2, 3, 4, 5, 60, 700], []])
    assert (value, low, high) == (pytest.approx(3.5), None, None)


def test_seeds_are_redrawn_within_their_game() -> None:
    """Games whose seeds agree leave nothing to chance, however much games differ."""
    assert bootstrapped(interquartile_mean, [[0.0, 0.0], [1.0, 1.0]]) == (0.5, 0.5, 0.5)
    _, low, high = bootstrapped(interquartile_mean, [[0.0, 1.0], [0.0, 1.0]])
    assert low < 0.25 < 0.75 < high
    assert bootstrapped(interquartile_mean, [[0.1, 0.2], [0.3]])[1:] == (None, None)


def test_a_profile_is_the_share_of_runs_above_each_score() -> None:
    """Above 30 %: one of two runs in one game, both in the other; above 40 %: none, and one of two."""
    value, low, high = bootstrapped(performance_profile, [[0.2, 0.4], [0.6, 0.4]])
    assert [value[i] for i in (0, 19, 20, 30, 40, 60)] == [1.0, 1.0, 0.75, 0.75, 0.25, 0.0]
    assert len(value) == len(low) == len(high) == 101
    assert (low[19], high[19], low[60], high[60]) == (1.0, 1.0, 0.0, 0.0)


def test_the_probability_of_improvement_counts_pairs_within_games() -> None:
    """Of four pairs one is won, one equal: 1.5/4; against a fixed agent one of two won, one equal: 1.5/2."""
    value, _, _ = bootstrapped(probability_of_improvement, [[0.1, 0.2], [0.5, 0.6], [0.15, 0.2], [0.5, 0.5]])
    assert value == pytest.approx((1.5 / 4 + 1.5 / 2) / 2)


@pytest.mark.parametrize(
    ("statistic", "games"),
    [(probability_of_improvement, [[0, 1, 1, 1, 1], [0.5, 0.5]]), (performance_profile, [[0, 1, 1, 1, 1]])],
)
def test_intervals_are_those_of_redrawn_runs(statistic, games) -> None:
    """One run of five scores 0: of five redrawn ones more than three do in 0.7 %, more than two in 5.8 %."""
    value, low, high = (
        float(np.atleast_1d(end)[-1 if len(games) > 1 else 50]) for end in bootstrapped(statistic, games)
    )
    assert (value, low, high) == (pytest.approx(0.8), pytest.approx(0.4), pytest.approx(1.0))
