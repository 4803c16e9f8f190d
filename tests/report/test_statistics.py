"""Shares over seeds and their differences, against hand arithmetic."""

from __future__ import annotations

import pytest

from apil_core.common.statistics import difference
from apil_core.evaluation.results import wilson
from apil_core.studies.report.statistics import (
    compared,
    interquartile_mean,
    published_rate,
    share,
    stratified_interval,
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
    assert interquartile_mean([0, 1, 2, 3, 4, 5, 60, 700]) == pytest.approx(3.5)


def test_seeds_are_redrawn_within_their_game() -> None:
    """Games whose seeds agree leave nothing to chance, however much games differ."""
    assert stratified_interval([[0.0, 0.0], [1.0, 1.0]]) == (0.5, 0.5)
    low, high = stratified_interval([[0.0, 1.0], [0.0, 1.0]]) or (0.5, 0.5)
    assert low < 0.25 < 0.75 < high
    assert stratified_interval([[0.1, 0.2], [0.3]]) is None
