"""Which differences are noise."""

from __future__ import annotations

import pytest

from apil_core.common.statistics import difference


def test_newcombes_interval_by_hand() -> None:
    """56 of 70 against 48 of 80, Newcombe 1998, table II (b): .2000, .0524 to .3339."""
    found = difference(56, 70, 48, 80)
    assert found.value == pytest.approx(0.2)
    assert (found.low, found.high) == pytest.approx((0.0524, 0.3339), abs=5e-5)
    assert not found.within_noise


def test_thirty_games_cannot_tell_a_third_from_a_half() -> None:
    assert difference(10, 30, 15, 30).within_noise


def test_equal_certainties_differ_by_nothing() -> None:
    assert difference(0, 50, 0, 50).value == 0
    assert difference(50, 50, 50, 50).within_noise
