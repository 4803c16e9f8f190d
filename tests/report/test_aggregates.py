"""Methods over all games."""

from __future__ import annotations

import pytest

from apil_core.studies.report.aggregates import aggregates
from report.sample import KICK, SUMO, hand_table


def test_only_games_in_which_everybody_was_measured_count() -> None:
    """ADRL 10, 20 and 90 %, but APL was not measured in the third game: mean of the first two."""
    games = {
        KICK: {"adrl": (100,), "apl": (300,)},
        SUMO: {"adrl": (200,), "apl": (400,)},
        "sumo-ants": {"adrl": (900,)},
    }
    found = {each.column: each for each in aggregates([hand_table(1, games)]) if each.metric == "win"}
    assert found["adrl"].games == [KICK, SUMO]
    assert found["adrl"].iqm == pytest.approx(0.15)
    assert (found["adrl"].low, found["adrl"].seeds) == (None, 1)
    assert "nothing about what other seeds" in found["adrl"].note


def test_one_game_is_no_aggregate() -> None:
    assert aggregates([hand_table(1, {KICK: {"adrl": (100,)}})]) == []


def test_blinded_scores_are_not_aggregated() -> None:
    assert aggregates([hand_table(2, {KICK: {"adrl": (100,)}, SUMO: {"adrl": (100,)}})]) == []


def test_seeds_give_an_interval() -> None:
    games = {KICK: {"adrl": (100, 200, 300)}, SUMO: {"adrl": (500, 600, 700)}}
    own = aggregates([hand_table(1, games)])[0]
    assert own.low is not None
    assert own.high is not None
    assert own.iqm == pytest.approx(0.4)  # of 1, 2, 3, 5, 6, 7 one falls away at either end: 2, 3, 5, 6
    assert own.low < own.iqm < own.high
    assert own.note == ""
