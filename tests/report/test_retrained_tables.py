"""Tables 3 and 4 out of a cross-play: who stands beside whom."""

from __future__ import annotations

from apil_core.evaluation.crossplay.document import CrossPlay, Player
from apil_core.studies.report.retrained_tables import Played, retrained_tables
from apil_core.studies.report.settings import Key
from apil_core.studies.report.table_models import Setting, Table
from report.sample import KICK, VICTIMS, result

COLUMNS = ["baseline", "adrl", "e_apil"]
MILLION = 1_000_000


def _key(victim: str, axes: tuple[tuple[str, str], ...] = ()) -> Key:
    """Of an adversary that was trained for a million steps."""
    return Key(MILLION, None, None, victim, "sample", "sample", axes)


def _played(
    adversaries: dict[str, tuple[int | None, int | None]],
    victims: list[str],
    attacks: dict[str, Key] | None = None,
) -> Played:
    """A cross-play in which adversary i wins 100·i + 10·j games of 1000 against victim j.

    Args:
        adversaries: training steps and seed by label.
        victims: labels.
        attacks: how adversaries were trained, by label.
    """
    methods = {label: None if label == "baseline" else label.partition("/")[0] for label in adversaries}
    document = CrossPlay(
        env=KICK,
        adversaries=[
            Player(name=f"run:/nowhere/{label}", sha256="", label=label, method=methods[label], seed=seed)
            for label, (_, seed) in adversaries.items()
        ],
        victims=[
            Player(
                name=VICTIMS[KICK] if label == "original" else "retrained:/nowhere", sha256="", label=label
            )
            for label in victims
        ],
        scores=[
            [result(KICK, 100 * i + 10 * j, 0, trained_steps=steps) for j, _ in enumerate(victims)]
            for i, (steps, _) in enumerate(adversaries.values())
        ],
        created="",
    )
    return Played(document, 500_000, attacks or {})


def _tables(*played: Played) -> tuple[list[Table], list[Setting]]:
    return retrained_tables(played, [KICK], COLUMNS, 1)


def _losses(table: Table) -> dict[str, list[tuple[int | None, int]]]:
    """Seed and games lost, by column."""
    return {cell.column: [(s.seed, s.losses) for s in cell.scores] for cell in table.rows[0] if cell.scores}


def test_victims_of_several_seeds_meet_the_adversary_of_their_seed() -> None:
    adversaries = {"baseline": (None, None), "e_apil/s0": (MILLION, 0), "e_apil/s1": (MILLION, 1)}
    (third, fourth), _ = _tables(_played(adversaries, ["original", "vs e_apil/s0", "vs e_apil/s1"]))
    assert _losses(third) == {"baseline": [(None, 0)], "e_apil": [(0, 10), (1, 20)]}
    assert _losses(fourth) == {"baseline": [(0, 100), (1, 200)], "e_apil": [(0, 110), (1, 220)]}


def test_budgets_are_tables_of_their_own() -> None:
    adversaries = {"baseline": (None, None), "e_apil/1M": (MILLION, 0), "e_apil/2M": (2 * MILLION, 0)}
    tables, settings = _tables(_played(adversaries, ["original", "vs e_apil/1M", "vs e_apil/2M"]))
    found = {(t.number, s.steps): _losses(t) for t in tables for s in settings if s.id == t.setting}
    assert found[4, MILLION] == {"baseline": [(0, 100)], "e_apil": [(0, 110)]}
    assert found[4, 2 * MILLION] == {"baseline": [(0, 200)], "e_apil": [(0, 220)]}
    assert found[3, MILLION] == {"baseline": [(None, 0)], "e_apil": [(0, 10)]}


def test_ablated_adversaries_neither_test_nor_make_the_usual_victims() -> None:
    adversaries = {"baseline": (None, None), "e_apil/none": (MILLION, 0), "e_apil/usual": (MILLION, 0)}
    ablated = _key("default", (("options.x", "none"),))
    played = _played(adversaries, ["original", "vs e_apil/none", "vs e_apil/usual"], {"e_apil/none": ablated})
    tables, settings = _tables(played)
    found = {(t.number, bool(s.axes)): _losses(t) for t in tables for s in settings if s.id == t.setting}
    assert found[4, False] == {"baseline": [(0, 200)], "e_apil": [(0, 220)]}
    assert found[4, True] == {"baseline": [(0, 200)], "e_apil": [(0, 210)]}
    changed = next(t for t in tables for s in settings if s.id == t.setting and s.axes and t.number == 4)
    assert [cell.win.published is None for cell in changed.rows[0]] == [False, True, True]


def test_the_same_cross_play_twice_counts_once() -> None:
    adversaries = {"baseline": (None, None), "e_apil": (MILLION, 0)}
    played = _played(adversaries, ["original", "vs e_apil"])
    (third, fourth), _ = _tables(played, played)
    assert _losses(third) == {"baseline": [(None, 0)], "e_apil": [(0, 10)]}
    assert _losses(fourth) == {"baseline": [(0, 100)], "e_apil": [(0, 110)]}


def test_pairings_that_are_not_played_yet_are_left_out() -> None:
    played = _played({"baseline": (None, None), "adrl": (MILLION, 0)}, ["original", "vs adrl"])
    played.document.scores[0][1] = None
    tables, _ = _tables(played)
    assert tables == []  # no E-APIL, and the baseline has not met the retrained one


def test_budgets_are_those_asked_for_wherever_the_last_iteration_ended() -> None:
    """Iterations of two sizes end beyond the budget at two places: one table all the same."""
    adversaries = {"baseline": (None, None), "adrl": (1_015_808, 0), "e_apil": (1_048_576, 0)}
    attacks = {label: _key("default") for label in ("adrl", "e_apil")}
    tables, settings = _tables(_played(adversaries, ["original", "vs adrl", "vs e_apil"], attacks))
    assert [(table.number, setting.steps) for table, setting in zip(tables, settings * 2, strict=True)] == [
        (3, MILLION),
        (4, MILLION),
    ]
    assert set(_losses(tables[1])) == {"baseline", "adrl", "e_apil"}


def test_adversaries_of_another_victim_are_no_further_seeds() -> None:
    adversaries = {"baseline": (None, None), "e_apil/a": (MILLION, 0), "e_apil/b": (MILLION, 0)}
    attacks = {"e_apil/a": _key("default"), "e_apil/b": _key("somebody else")}
    (_, fourth), _ = _tables(_played(adversaries, ["original", "vs e_apil/a"], attacks))
    assert _losses(fourth) == {"baseline": [(0, 100)], "e_apil": [(0, 110)]}
