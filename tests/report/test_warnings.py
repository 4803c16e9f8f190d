"""Warnings are computed from the numbers."""

from __future__ import annotations

import pytest

from apil_core.studies.report.cells import cell
from apil_core.studies.report.models import Warning
from apil_core.studies.report.report_data import placed
from apil_core.studies.report.table_models import Cell, SeedScore, Setting
from apil_core.studies.report.warnings import tie_meaning
from apil_core.studies.report.words import amount, budget_mark


def _endings(wins: int, ties: int, losses: int, **causes: int) -> Cell:
    named = {name.replace("_", "-"): count for name, count in causes.items()}
    games = {"episodes": wins + ties + losses, "wins": wins, "ties": ties, "losses": losses}
    score = SeedScore(seed=0, source="cells/x", steps=1, causes=named, mean_length=1.0, **games)
    return cell("kick-and-defend", "adrl", [score], None)


def test_an_ending_that_counts_as_often_as_ties_is_what_a_tie_is() -> None:
    one = _endings(3, 97, 0, keeper_left_goal=97, both_down=3)
    assert tie_meaning(one, [one]) == "; a tie here means: keeper left goal"


def test_chance_equality_in_one_score_is_settled_by_another() -> None:
    """50 ties, 50 losses: either ending could be the tie; the second score tells which."""
    one = _endings(0, 50, 50, keeper_left_goal=50, goal=50)
    other = _endings(0, 20, 80, keeper_left_goal=20, goal=80)
    assert tie_meaning(one, [one]) == ""
    assert tie_meaning(one, [one, other]) == "; a tie here means: keeper left goal"


def test_a_frequent_ending_must_be_ties_at_least_in_part() -> None:
    """Of 100 games 90 are ties, 88 ended one way: at most 10 of these are no ties, so 78 of 90 are, 87 %."""
    one = _endings(5, 90, 5, left_ring=88, time_up=12)
    assert tie_meaning(one, [one]) == "; at least 87 % of the ties are: left ring"


@pytest.mark.parametrize(
    ("steps", "mark"),
    [
        (1_000_000, "1 M of 35 M = 2.9 %"),
        (100_000, "100 k of 35 M = 0.29 %"),
        (34_900_000, "34.9 M of 35 M = 99.7 %"),
        (34_999_999, "35 M of 35 M = 99.9 %"),
        (35_000_000, ""),
        (40_000_000, ""),
    ],
)
def test_a_short_budget_is_marked_with_its_share(steps: int, mark: str) -> None:
    assert budget_mark(steps, 35_000_000) == mark
    assert Setting(id="s1", label="", steps=steps, published_steps=35_000_000).budget == mark


def test_amounts_are_short() -> None:
    assert [amount(n) for n in (35_000_000, 1_500_000, 300_000, 512)] == ["35 M", "1.5 M", "300 k", "512"]
    assert [amount(n) for n in (999_600, 1_234_000_000)] == ["1 M", "1234 M"]


def test_a_warning_of_two_settings_is_given_once_and_one_of_a_cell_names_its_setting() -> None:
    settings = [Setting(id="s1", label="1 M steps"), Setting(id="s2", label="2 M steps")]
    loud = [Warning(kind="settings", loud=True, text="Options.", setting=each.id) for each in settings]
    cells = [Warning(kind="ties", loud=False, text="Ties.", setting=each.id) for each in settings]
    texts = [warning.text for warning in placed([*loud, *cells], settings)]
    assert texts == ["Options.", "1 M steps: Ties.", "2 M steps: Ties."]
