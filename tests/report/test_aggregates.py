"""Methods over all games."""

from __future__ import annotations

import pytest

from apil_core.studies.report.aggregates import aggregates, improvements, profiles
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


def test_one_game_is_an_aggregate_of_its_seeds_only() -> None:
    assert aggregates([hand_table(1, {KICK: {"adrl": (100,)}})]) == []
    tables = [hand_table(1, {KICK: {"adrl": (100, 200), "apl": (150, 300)}})]
    assert [each.iqm for each in aggregates(tables)][:2] == [pytest.approx(0.15), pytest.approx(0.225)]
    (improved, _) = improvements(tables)
    assert (improved.value, improved.runs, improved.base_runs) == (pytest.approx(3 / 4), 2, 2)


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


def test_profiles_and_improvements_need_two_seeds_in_every_game() -> None:
    """APL has one seed in a game; the baseline is one fixed agent, which runs can be compared with."""
    games = {
        KICK: {"baseline": (150,), "adrl": (100, 200), "apl": (100, 200), "e_apil": (200, 300)},
        SUMO: {"baseline": (50,), "adrl": (500, 600), "apl": (400,), "e_apil": (600, 700)},
    }
    table = hand_table(1, games)
    shown = [each for each in profiles([table]) if each.metric == "win"]
    assert [(each.column, each.runs) for each in shown] == [("adrl", 4), ("e_apil", 4)]
    assert shown[0].value[15] == pytest.approx((1 / 2 + 1) / 2)
    found = {(e.column, e.base): e for e in improvements([table]) if e.metric == "win"}
    assert list(found) == [("adrl", "baseline"), ("e_apil", "baseline"), ("e_apil", "adrl")]
    assert found["adrl", "baseline"].value == pytest.approx((1 / 2 + 1) / 2)
    assert (found["adrl", "baseline"].runs, found["adrl", "baseline"].base_runs) == (4, 2)
    # 200 and 300 against 100 and 200 wins: three pairs of four, one equal, in both games
    assert found["e_apil", "adrl"].value == pytest.approx(3.5 / 4)
    assert found["e_apil", "adrl"].low <= 3.5 / 4 <= found["e_apil", "adrl"].high == 1.0


def test_one_seed_has_no_profile() -> None:
    table = hand_table(1, {KICK: {"adrl": (100,), "apl": (300,)}, SUMO: {"adrl": (200,), "apl": (400,)}})
    assert len(aggregates([table])) == 4
    assert profiles([table]) == improvements([table]) == []
