"""Measured beside published scores: arithmetic, which rows there are, and that no finished one is lost."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import pytest

from apil_core import ConfigError, GameSpec, Matchup, PublishedScore, Section
from apil_core.common.files import locked_for
from apil_core.common.statistics import difference
from apil_core.evaluation.fidelity.plan import Plan, RowPlan, plan_rows, switches
from apil_core.evaluation.fidelity.play import missing_policy, play_rows, summary
from apil_core.evaluation.fidelity.rows import FidelityRow
from apil_core.evaluation.options import FidelityOptions
from apil_core.evaluation.progress import Progress
from apil_core.evaluation.results import EvaluationResult, wilson
from apil_core.plugins.discovery import PluginRegistry, discover

VICTIM = "scripted:toy-pursuit/evader/v1"
PUBLISHED = PublishedScore(30, 40, 100, "made up", adversary_actions="mode")


class Options(Section):
    rough: bool = False
    solver: Literal["slow", "quick", "wild"] = "slow"
    steps: int = 5


def spec(*matchups: Matchup, config: str | None = f"{__name__}:Options") -> GameSpec:
    return GameSpec("game", "nowhere:Game", config=config, matchups=matchups)


def planned(*games: GameSpec, absent: tuple[str, ...] = (), **request: Any) -> Plan:
    return plan_rows(games, FidelityOptions(**request), lambda name: "not here" if name in absent else None)


def row(wins: int, ties: int, games: int, published: PublishedScore | None = PUBLISHED) -> FidelityRow:
    plan = planned(spec(Matchup("a", "v", published)), episodes=games).rows[0]
    losses = games - wins - ties
    facts = {"adversary": {"name": "a", "sha256": ""}, "victim": {"name": "v", "sha256": ""}}
    rates = {
        name: wilson(count, games)
        for name, count in (
            ("win_rate", wins),
            ("tie_rate", ties),
            ("loss_rate", losses),
            ("win_or_tie_rate", wins + ties),
        )
    }
    result = EvaluationResult(
        **facts,
        **rates,
        env="game",
        episodes=games,
        wins=wins,
        ties=ties,
        losses=losses,
        causes={"end": games},
        mean_length=1,
        adversary_side="left",
        victim_side="right",
        adversary_actions="sample",
        victim_actions="sample",
        seed=0,
        num_envs=1,
        game_options={},
        versions={},
        wall_seconds=1,
    )
    return FidelityRow(plan=plan, result=result)


# --- arithmetic


def test_newcombe_by_hand() -> None:
    # Wilson of 50/100: .40383 … .59617, of 30/100: .21895 … .39584; the ends combine as
    # .2 − √(.09617² + .09584²) = .06423 and .2 + √(.09617² + .08105²) = .32577
    made = difference(50, 100, 30, 100)
    assert made.value == pytest.approx(0.2)
    assert made.low == pytest.approx(0.06423, abs=1e-4)
    assert made.high == pytest.approx(0.32577, abs=1e-4)
    assert not made.within_noise


def test_the_verdict_is_whether_the_interval_holds_nought() -> None:
    far = row(50, 0, 100)  # wins: 50 of 100 against a published 30 %; wins and ties: 50 against 40 %
    assert far.win.verdict == "differs by +20.0 [6.4, 32.6]"
    assert far.win_or_tie.difference is not None
    assert far.win_or_tie.verdict == "agrees: +10.0 [-3.7, 23.2]"
    assert summary(far).startswith(
        "game, a against v, sampled/sampled: 50.0 % wins, 50.0 % wins and ties (differs"
    )
    few = row(20, 0, 100)
    assert few.win.verdict.startswith("agrees: -10.0 [")


def test_wins_and_ties_are_counted_apart() -> None:
    both = row(30, 10, 100)
    assert both.win.measured.value == pytest.approx(0.3)
    assert both.win_or_tie.measured.value == pytest.approx(0.4)
    assert (both.win.verdict[:12], both.win_or_tie.verdict[:12]) == ("agrees: +0.0", "agrees: +0.0")


def test_without_a_published_score_there_is_no_verdict() -> None:
    plain = row(50, 0, 100, None)
    assert (plain.win.published, plain.win.difference, plain.win.verdict) == (None, None, "")
    assert summary(plain) == "game, a against v, sampled/sampled: 50.0 % wins, 50.0 % wins and ties"


# --- planning


def test_every_row_says_what_is_played() -> None:
    (default, published) = planned(spec(Matchup("a", "v", PUBLISHED)), episodes=200, seed=3).rows
    assert (default.kind, default.setting, default.episodes) == ("default", "sampled/sampled", 200)
    assert (default.seed, default.num_envs, default.published) == (3, 128, PUBLISHED)
    # only the adversary's mode is known: the victim's stays at its default
    assert (published.kind, published.setting, published.episodes) == ("as-published", "mode/sampled", 200)


def test_switches_are_read_from_the_option_model() -> None:
    modes = [
        {"adversary_actions": a, "victim_actions": v}
        for a, v in (("sample", "mode"), ("mode", "sample"), ("mode", "mode"))
    ]
    assert switches(None) == modes
    assert switches(Options) == [*modes, {"rough": True}, {"solver": "quick"}, {"solver": "wild"}]


def test_one_switch_at_a_time_and_no_row_twice() -> None:
    plan = planned(spec(Matchup("a", "v", PUBLISHED)), episodes=100, switches=True, switch_episodes=50)
    settings = [(r.kind, r.setting, r.episodes, r.num_envs) for r in plan.rows]
    assert settings == [
        ("default", "sampled/sampled", 100, 100),
        ("as-published", "mode/sampled", 100, 100),
        ("switch", "sampled/mode", 50, 50),
        ("switch", "mode/mode", 50, 50),
        ("switch", "sampled/sampled, rough True", 50, 50),
        ("switch", "sampled/sampled, solver quick", 50, 50),
        ("switch", "sampled/sampled, solver wild", 50, 50),
    ]
    assert all(r.options == {} or len(r.options) == 1 for r in plan.rows)


def test_defaults_of_all_games_come_first() -> None:
    other = replace(spec(Matchup("b", "w")), name="other")
    plan = planned(spec(Matchup("a", "v", PUBLISHED)), other)
    assert [(r.env, r.kind) for r in plan.rows] == [
        ("game", "default"),
        ("other", "default"),
        ("game", "as-published"),
    ]


def test_a_variant_is_played_where_a_game_has_its_options() -> None:
    bare = replace(spec(Matchup("b", "w"), config=None), name="bare")
    variants = [{"solver": "quick", "rough": True}, {"victim_actions": "mode"}]
    plan = planned(spec(Matchup("a", "v")), bare, variants=variants)
    assert [(r.env, r.setting) for r in plan.rows if r.kind == "variant"] == [
        ("game", "sampled/sampled, solver quick, rough True"),
        ("game", "sampled/mode"),
        ("bare", "sampled/mode"),
    ]


@pytest.mark.parametrize(
    ("variant", "message"),
    [
        ({"sover": "quick"}, "variant: unknown key 'sover' (did you mean 'solver'?"),
        ({"solver": "quack"}, "variant: game game: solver: Input should be 'slow', 'quick' or 'wild'"),
        ({"victim_actions": "best"}, "variant: victim_actions must be sample or mode, got 'best'"),
    ],
)
def test_a_wrong_variant_is_refused_before_anything_is_played(variant: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError) as caught:
        planned(spec(Matchup("a", "v")), variants=[variant])
    assert message in str(caught.value)


@pytest.mark.parametrize("name", ["episodes", "switch_episodes", "num_envs"])
def test_numbers_below_one_are_refused(name: str) -> None:
    with pytest.raises(ConfigError, match=f"{name} must be at least 1, got 0"):
        planned(spec(), **{name: 0})


def test_what_is_missing_is_skipped_and_its_stand_in_played() -> None:
    wanted, stand_in = Matchup("a2", "v", PUBLISHED), Matchup("a1", "v", PUBLISHED, stands_in_for="a2")
    assert {r.adversary for r in planned(spec(wanted, stand_in)).rows} == {"a2"}
    plan = planned(spec(wanted, stand_in), absent=("a2",))
    assert {(r.adversary, r.stands_in_for) for r in plan.rows} == {("a1", "a2")}
    assert [(s.env, s.adversary, s.reason) for s in plan.skipped] == [("game", "a2", "not here")]


def test_published_pairings_of_the_games_are_complete() -> None:
    games = {name: game.matchups for name, game in discover().games.items() if game.matchups}
    scores = {
        name: m[0].published and (m[0].published.win, m[0].published.win_or_tie) for name, m in games.items()
    }
    assert scores == {
        "kick-and-defend": (28, 29),
        "you-shall-not-pass": (38, 38),
        "sumo-humans": (7, 7),
        "sumo-ants": (39, 56),
        "run-to-goal-humans": None,
        "run-to-goal-ants": None,
    }
    for name, matchups in games.items():
        spec = discover().games[name]
        assert (matchups[0].adversary, matchups[0].victim) == (spec.baseline_adversary, spec.default_victim)


# --- playing


@pytest.fixture(scope="module")
def plugins() -> PluginRegistry:
    registry = discover()
    toy = registry.games["toy-pursuit"]
    matchup = Matchup("baseline:random/7x2", VICTIM, PUBLISHED)
    registry.games["toy-pursuit"] = replace(toy, matchups=(matchup,))
    return registry


@pytest.fixture
def plans(plugins: PluginRegistry) -> list[RowPlan]:
    request = FidelityOptions(episodes=20, switches=True, switch_episodes=10)
    return plan_rows([plugins.games["toy-pursuit"]], request, missing_policy(plugins)).rows


class StopError(Exception):
    pass


class Impatient(Progress):
    """Breaks off at the first report of the third row."""

    rows = 0

    def note(self, text: str) -> None:
        self.rows += 1

    def evaluation_progress(self, done: int, total: int) -> None:
        if self.rows == 2:
            raise StopError


def figures(rows: list[FidelityRow]) -> list[tuple[object, ...]]:
    return [(r.plan.setting, r.result.wins, r.result.ties, r.result.causes) for r in rows]


def test_a_half_finished_file_is_continued(
    plugins: PluginRegistry, plans: list[RowPlan], tmp_path: Path
) -> None:
    path = tmp_path / "rows.jsonl"
    with pytest.raises(StopError):
        play_rows(plans, plugins=plugins, threads=1, progress=Impatient(), out=path)
    assert len(path.read_text().splitlines()) == 2
    first = path.read_text()

    class Counting(Progress):
        notes: list[str] = []

        def note(self, text: str) -> None:
            self.notes.append(text)

    rows = play_rows(plans, plugins=plugins, threads=1, progress=Counting(), out=path)
    assert len(Counting.notes) == len(plans) - 2
    assert Counting.notes[-1].startswith(f"{len(plans)} of {len(plans)} rows: toy-pursuit, ")
    assert path.read_text().startswith(first)
    assert figures(rows) == figures(play_rows(plans, plugins=plugins, threads=1))
    assert [r.plan for r in rows] == plans


def test_a_score_names_all_it_depends_on(plugins: PluginRegistry, plans: list[RowPlan]) -> None:
    (played,) = play_rows(plans[1:2], plugins=plugins, threads=1)
    assert (played.result.adversary_actions, played.result.victim_actions) == ("mode", "sample")
    assert played.result.adversary.name == "baseline:random/7x2"
    assert played.result.game_options == {"max_steps": 50}
    dumped = played.model_dump(mode="json")
    assert dumped["win"]["verdict"] == played.win.verdict
    assert dumped["win_or_tie"]["measured"]["value"] == played.result.win_or_tie_rate.value


@pytest.mark.parametrize(
    ("change", "message"), [({"seed": 1}, "seed 0, this call has 1"), ({"episodes": 30}, "20")]
)
def test_a_file_with_other_settings_is_refused(
    plugins: PluginRegistry, plans: list[RowPlan], tmp_path: Path, change: dict[str, int], message: str
) -> None:
    path = tmp_path / "rows.jsonl"
    play_rows(plans[:1], plugins=plugins, threads=1, out=path)
    before = path.read_text()
    other = plans[0].model_copy(update=change)
    with pytest.raises(ConfigError, match=message) as caught:
        play_rows([other], plugins=plugins, threads=1, out=path)
    assert "\n" not in str(caught.value)
    assert path.read_text() == before


def test_a_damaged_file_and_a_wrong_place_are_refused(plugins: PluginRegistry, tmp_path: Path) -> None:
    path = tmp_path / "rows.jsonl"
    path.write_text("{}\n")
    places = {
        path: r"rows.jsonl:1: this line is no row",
        tmp_path: "is a directory",
        tmp_path / "no" / "rows.jsonl": "its directory does not exist",
        Path("/proc/rows.jsonl"): "cannot be written",
    }
    for place, message in places.items():
        with pytest.raises(ConfigError, match=message):
            play_rows([], plugins=plugins, out=place)


def test_two_may_not_write_one_file(plugins: PluginRegistry, plans: list[RowPlan], tmp_path: Path) -> None:
    path = tmp_path / "rows.jsonl"
    with locked_for(path, "apil fidelity"), pytest.raises(ConfigError, match="another apil fidelity"):
        play_rows(plans[:1], plugins=plugins, threads=1, out=path)
    assert not path.exists()


@pytest.mark.parametrize(
    ("old", "new"), [('"max_steps":50', '"max_steps":49'), ('"sha256":"', '"sha256":"0')], ids=str
)
def test_rows_of_other_games_or_players_are_not_taken(
    plugins: PluginRegistry, plans: list[RowPlan], tmp_path: Path, old: str, new: str
) -> None:
    path = tmp_path / "rows.jsonl"
    play_rows(plans[:1], plugins=plugins, threads=1, out=path)
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(ConfigError, match="take another --out file"):
        play_rows(plans[:1], plugins=plugins, threads=1, out=path)
