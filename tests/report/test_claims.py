"""Claims hold, do not hold or cannot be told: on tables written by hand."""

from __future__ import annotations

import re
from itertools import pairwise

from apil_core.studies.report.claims import claims
from apil_core.studies.report.models import Check, Claim, Truth
from apil_core.studies.report.paper_claims import IN_THE_PAPER, MARGIN, ORDER
from apil_core.studies.report.published import published
from apil_core.studies.report.table_models import Setting, Table
from report.sample import KICK, Counts, hand_table

FULL, SHORT = 35_000_000, 1_000_000


def _setting(steps: int) -> Setting:
    return Setting(id="s1", label="as it was", steps=steps, published_steps=FULL)


def _all(**cells: Counts) -> dict[str, Counts]:
    """Every column measured once; the ones not named win 600 games, the baseline 280."""
    return {"baseline": (280,), **dict.fromkeys(ORDER, (600,)), **cells}


def _found(tables: list[Table], steps: int = FULL) -> dict[str, Claim]:
    return {claim.id: claim for claim in claims(tables, [_setting(steps)])}


def _check(tables: list[Table], name: str, steps: int = FULL) -> Check:
    """Of the only game."""
    (check,) = _found(tables, steps)[name].checks
    return check


def _truth(tables: list[Table], name: str, steps: int = FULL) -> Truth:
    return _check(tables, name, steps).verdict


def test_an_attack_beats_the_baseline_only_beyond_noise() -> None:
    """Of 1000 games 300 against 280 is noise, 480 is not; 200 is a refutation, but only at full budget."""
    cases: dict[int, tuple[Truth, Truth]] = {
        480: ("holds", "holds"),
        300: ("cannot be told", "cannot be told"),
        200: ("does not hold", "cannot be told"),
    }
    for wins, (full, short) in cases.items():
        tables = [hand_table(1, {KICK: _all(adrl=(wins,))})]
        assert _truth(tables, "beats baseline", FULL) == full
        assert _truth(tables, "beats baseline", SHORT) == short


def test_a_claim_is_about_all_games_of_the_paper() -> None:
    every = {game: _all() for game in published().games}
    assert _found([hand_table(1, every)])["beats baseline"].verdict == "holds"
    noisy = {**every, KICK: _all(apl=(290,))}
    assert _found([hand_table(1, noisy)])["beats baseline"].verdict == "cannot be told"
    worse = _found([hand_table(1, {**every, KICK: _all(apl=(100,))})])["beats baseline"]
    assert worse.verdict == "does not hold"
    assert [check.verdict for check in worse.checks] == ["does not hold", "holds", "holds", "holds"]
    less = _found([hand_table(1, {KICK: _all()})])["beats baseline"]
    assert (less.verdict, less.checks[0].verdict) == ("cannot be told", "holds")
    assert "Not measured: you-shall-not-pass, sumo-humans, sumo-ants." in less.text


def test_a_claim_is_about_all_methods_of_the_paper_and_no_other() -> None:
    some = {name: counts for name, counts in _all().items() if name != "apil"}
    check = _check([hand_table(1, {KICK: some})], "beats baseline")
    assert (check.verdict, "apil not measured" in check.text) == ("cannot be told", True)
    others = hand_table(1, {KICK: {**_all(), "my_own": (3,)}}, columns=("baseline", *ORDER, "my_own"))
    assert _truth([others], "beats baseline") == "holds"


def test_without_the_baseline_nothing_can_be_told() -> None:
    check = _check([hand_table(1, {KICK: dict.fromkeys(ORDER, (600,))})], "beats baseline")
    assert (check.verdict, "was not measured" in check.text) == ("cannot be told", True)


def test_an_order_of_methods_needs_seeds() -> None:
    one = {"adrl": (100,), "apl": (300,), "apil": (500,), "e_apil": (700,)}
    three = {name: (counts[0], counts[0] + 5, counts[0] - 5) for name, counts in one.items()}
    assert _truth([hand_table(1, {KICK: one})], "order") == "cannot be told"
    assert "1 seed each" in _check([hand_table(1, {KICK: one})], "order").text
    assert _truth([hand_table(1, {KICK: three})], "order") == "holds"
    assert _truth([hand_table(1, {KICK: {**three, "apil": (200, 205, 195)}})], "order") == "does not hold"


def test_blinding_costs_nothing_only_if_ten_points_are_excluded() -> None:
    """Of 1000 games each, ±4.4 points: lost are 0, 5 (surely less than ten), 7 (maybe more), 18 (surely)."""
    seeing = hand_table(1, {KICK: _all(adrl=(480,))})
    verdicts = {480: "holds", 430: "holds", 410: "cannot be told", 300: "does not hold"}
    for wins, expected in verdicts.items():
        assert _truth([seeing, hand_table(2, {KICK: _all(adrl=(wins,))})], "blinding") == expected
    few = [hand_table(1, {KICK: _all(adrl=(3,))}), hand_table(2, {KICK: _all(adrl=(3,))})]
    check = _check(few, "blinding")
    assert (check.verdict, "too little to lose" in check.text) == ("cannot be told", True)


def test_hardened_victims_resist_and_remember() -> None:
    """The counts stand for the victim's wins here."""

    def third(wins: int) -> list[Table]:
        return [hand_table(3, {KICK: _all(baseline=(720,), **dict.fromkeys(ORDER, (wins,)))}, "victim")]

    def fourth(wins: int) -> list[Table]:
        return [hand_table(4, {KICK: {"baseline": (300,), "e_apil": (wins,)}}, "victim")]

    assert [_truth(fourth(wins), "resists") for wins in (600, 310)] == ["holds", "cannot be told"]
    assert [_truth(third(wins), "remembers") for wins in (700, 400)] == ["holds", "does not hold"]
    assert _truth(third(400), "remembers", SHORT) == "cannot be told"


def test_both_short_budgets_of_a_hardened_victim_are_told() -> None:
    table = hand_table(4, {KICK: {"baseline": (300,), "e_apil": (310,)}}, "victim")
    texts = []
    for retrained in (500_000, 10_000_000):
        budgets = {"steps": SHORT, "retrain_steps": retrained, "published_steps": 10_000_000}
        (claim,) = claims([table], [Setting(id="s1", label="", **budgets)])
        texts.append(claim.text)
    assert "(500 k of 10 M = 5 % and 1 M of 35 M = 2.9 %)" in texts[0]
    assert "(1 M of 35 M = 2.9 %)" in texts[1]


def test_the_papers_own_tables_are_held_against_its_claims() -> None:
    """Every number in the sentences is in published_results.json, and the counts are of its cells."""
    table = published().tables[1].rows
    for name, place in (("beats baseline", 1), ("order", 1), ("order on wins", 0)):
        pairs = (
            list(pairwise(ORDER)) if name != "beats baseline" else [("baseline", method) for method in ORDER]
        )
        signs = [row[b][place] - row[a][place] for row in table.values() for a, b in pairs]
        assert f"above in {sum(d > 0 for d in signs)} of {len(signs)};" in IN_THE_PAPER[name]
        assert IN_THE_PAPER[name].count(" against ") == sum(d < 0 for d in signs)
    above = [row["e_apil"][0] > row["baseline"][0] for row in published().tables[4].rows.values()]
    assert f"above in {sum(above)} of 4" in IN_THE_PAPER["resists"]
    for name, numbers, place in (("blinding", (1, 2), 1), ("remembers", (3, 3), 0)):
        before, after = (published().tables[number].rows for number in numbers)
        lost = {
            f"{column} {100 * a:.0f} → {100 * b:.0f} in {game}"
            for game in before
            for column in after[game]
            for a, b in [
                (
                    before[game][column if name == "blinding" else "baseline"][place],
                    after[game][column][place],
                )
            ]
            if round(a - b, 9) > MARGIN
        }
        assert set(re.findall(r"\w+ \d+ → \d+ in [a-z-]+", IN_THE_PAPER[name])) == lost
