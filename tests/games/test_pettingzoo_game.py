"""PettingZoo environments of others as games."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from envs.test_game_contract import started
from gymnasium.spaces import Discrete, flatten
from pettingzoo.test import parallel_api_test

from apil_core import (
    NO_WINNER,
    ApilError,
    ConfigError,
    Game,
    ParallelGameEnv,
    PettingZooOptions,
    PluginError,
    make_game,
)
from apil_core.games.pettingzoo.spaces import Actions, Seat
from apil_core.testing.game_checks import CHECKS
from apil_core.testing.game_play import Play, Trial, same
from games.odd_envs import Masked, Race, Scripted

RACE = "pettingzoo:games.odd_envs:Race"
MASKED = "pettingzoo:games.odd_envs:Masked"
SCRIPTED = "pettingzoo:games.odd_envs:Scripted"
PUSH = "pettingzoo:mpe2.simple_push_v3:parallel_env"


def race(num_envs: int, threads: int = 1) -> Game:
    return make_game(RACE, num_envs=num_envs, threads=threads)


def masked(num_envs: int, threads: int = 1) -> Game:
    return make_game(MASKED, num_envs=num_envs, threads=threads)


def simple_push(num_envs: int, threads: int = 1) -> Game:
    return make_game(PUSH, num_envs=num_envs, threads=threads)


def scripted(plan: dict[int, Any] | None = None, threads: int = 1, **options: Any) -> Game:
    """One game that goes by ``plan``, started."""
    kwargs = {"plan": plan or {}, **options.pop("kwargs", {})}
    game = make_game(SCRIPTED, num_envs=threads, threads=threads, options={"kwargs": kwargs, **options})
    game.reset()
    return game


def still(game: Game) -> tuple[np.ndarray, np.ndarray]:
    first, second = (np.zeros((game.num_envs, s.action_size), np.float32) for s in game.layout.sides)
    return first, second


def last(game: Game, steps: int) -> Any:
    for _ in range(steps):
        step = game.step(still(game))
    return step


def ending(game: Game, steps: int) -> tuple[str, int, list[float]]:
    """Cause, winner and sparse rewards of game 0, which must end with that very step."""
    step = last(game, steps)
    assert step.done[0]
    assert step.lengths[0] == steps
    return game.layout.causes[step.cause[0]], int(step.winner[0]), step.sparse[:, 0].tolist()


# --- the contract of games


@pytest.mark.parametrize("check", [name for name in CHECKS if name != "views"])
@pytest.mark.parametrize("make", [race, simple_push, masked])
def test_the_contract_of_games(check: str, make: Callable[..., Game]) -> None:
    trial = Trial(make.__name__, make)
    CHECKS[check](trial)
    assert not trial.skipped


def test_pettingzoo_sees_it_as_one_of_its_own() -> None:
    parallel_api_test(ParallelGameEnv(race(1)), num_cycles=40)


def test_our_own_view_comes_back_as_a_game() -> None:
    options = {"kwargs": {"game": "toy-pursuit"}, "winner": "info"}
    game = make_game("pettingzoo:apil_core:ParallelGameEnv", num_envs=3, options=options)
    assert [side.name for side in game.layout.sides] == ["evader", "pursuer"]
    game.reset()
    run = np.array([[1, 0]] * 3, np.float32), np.zeros((3, 2), np.float32)
    steps = [game.step(run) for _ in range(50)]
    winners = np.stack([step.winner for step in steps]).max(0)
    assert (winners == 0).any()


# --- spaces


def test_discrete_observations_and_dicts_become_flat() -> None:
    game = race(1)
    game.seed(1)
    game.reset()
    cart, hare = game.layout.sides
    assert cart.blocks == {"place": slice(0, 2), "who": slice(2, 5)}
    assert hare.blocks == {"observation": slice(0, 4)}
    first, second = game.observations
    np.testing.assert_array_equal(first[0, 2:], [1, 0, 0])
    np.testing.assert_array_equal(second[0, :2], first[0, 1::-1])
    game.step(still(game))
    np.testing.assert_array_equal(game.observations[0][0, 2:], [0, 1, 0])
    assert game.observations[1][0, 2] == 1


@pytest.mark.parametrize(
    ("kind", "seen"),
    [
        ("discrete", [0, 0, 0, 1]),
        ("binary", [1, 0, 1]),
        ("box", [0.5, 0.25]),
        ("whole", [2, 1]),
        ("multi", [0, 0, 1, 0, 1]),
        ("parts", [1, 0, 0.5, 1, 0, 1, 0, 0, 1]),
    ],
)
def test_kinds_of_observations(kind: str, seen: list[float]) -> None:
    game = scripted(kwargs={"observations": kind})
    assert game.observations[0].tolist() == [seen]
    env = Scripted(observations=kind)
    flat = flatten(env.observation_space("a"), env.reset()[0]["a"])
    assert flat.tolist() == seen, "as gymnasium has it"


OUTSIDE = [
    ("discrete", -1, r"Discrete\(4\) has no -1"),
    ("discrete", 4, r"Discrete\(4\) has no 4"),
    ("discrete", 1.5, r"Discrete\(4\) has no 1\.5"),
    ("discrete", None, r"Discrete\(4\) has no None"),
    ("binary", np.array([0, 0.5, 1]), r"MultiBinary\(3\) has no 0\.5"),
    ("binary", np.array([0, 2, 1]), r"MultiBinary\(3\) has no 2"),
    ("whole", np.array([0.7, 1]), r"Box\(0, 255, \(2,\), uint8\) has no 0\.7"),
    ("whole", np.array([1, 300]), r"Box\(0, 255, \(2,\), uint8\) has no 300"),
    ("multi", np.array([3, 0]), r"MultiDiscrete\(\[3 2\]\) has no 3"),
    ("box", np.zeros(1, np.float32), r"Box\(-1\.0, 1\.0, \(2,\), float32\) has no \[0\.\]"),
    ("box", np.array(["0.5", "1"]), r"has no \['0\.5' '1'\]"),
    ("parts", (0, {"a": np.zeros((1, 2)), "b": np.array([1, 3])}), r"MultiDiscrete\(\[2 3\]\) has no 3"),
    ("parts", (0, {"a": np.zeros((1, 2))}), r"has no \(0, \{'a': array"),
]


@pytest.mark.parametrize(("kind", "value", "message"), OUTSIDE)
def test_observations_outside_their_space_are_refused(kind: str, value: Any, message: str) -> None:
    """Not truncated, wrapped or one-hot in the neighbour's place, as gymnasium's flatten does."""
    for time, error in ((2, ConfigError), (12, PluginError)):  # in the first trial, and in the game
        kwargs = {"observations": kind, "plan": {time: {"sees": {"b": value}}}}
        with pytest.raises(error, match=f"ValueError: agent 'b': its observation space .*{message}"):
            last(scripted(kwargs=kwargs), 12)


def test_other_numbers_are_checked_when_the_game_is_tried() -> None:
    with pytest.raises(ConfigError, match=r"agent 'a': .* Box\(-1\.0, 1\.0, \(2,\), float32\) has no 2\.0"):
        scripted({2: {"sees": {"a": np.array([2, 0], np.float32)}}})
    assert last(scripted({12: {"seen": 2}}), 12).done.tolist() == [False]


@pytest.mark.parametrize(
    ("what", "message"),
    [
        ({"pay": {"b": np.ones(1)}}, r"agent 'b': reward array\(\[1\.\]\) is no number"),
        ({"pay": {"a": None}}, "agent 'a': reward None is no number"),
        ({"pay": {"a": "3"}}, "agent 'a': reward '3' is no number"),
        ({"infos": None}, "agent 'a': info None: expected a dict"),
        ({"infos": {"b": [1]}}, r"agent 'b': info \[1\]: expected a dict"),
        ({"infos": {"b": {"winner": "no"}}}, "agent 'b': info {'winner': 'no'}: .*any 'winner' in it a bool"),
    ],
)
def test_odd_rewards_and_infos_are_refused(what: dict[str, Any], message: str) -> None:
    for time, error in ((2, ConfigError), (12, PluginError)):
        with pytest.raises(error, match=f"ValueError: {message}"):
            last(scripted({time: what}), 12)


def test_box_actions_reach_both_bounds() -> None:
    actions = Actions(Race().action_space("cart"))
    given = np.array([[-1, -1], [1, 1], [0, 0], [0.5, -9]], np.float32)
    np.testing.assert_array_equal(actions.native(given), [[0, -3], [1, 5], [0.5, 1], [0.75, -3]])
    assert actions.native(given).dtype == np.float32


def test_a_symmetric_box_changes_nothing() -> None:
    actions = Actions(Scripted().action_space("a"))
    given = np.random.default_rng(0).uniform(-1, 1, (50, 2)).astype(np.float32)
    np.testing.assert_array_equal(actions.native(given), given)


def test_whole_numbers_are_rounded() -> None:
    actions = Actions(Scripted(actions="whole").action_space("a"))
    np.testing.assert_array_equal(actions.native(np.array([[-1], [0.1], [1]])), [[0], [6], [10]])
    assert actions.native(np.zeros((1, 1))).dtype == np.int32


def test_the_largest_score_is_chosen() -> None:
    actions = Actions(Race().action_space("hare"))
    scores = np.array([[0, 0, 1], [3, 2, 1], [0, 0, 0], [-5, -4, -6]], np.float32)
    assert actions.native(scores).tolist() == [4, 2, 2, 3]
    assert actions.size == 3


def test_scores_have_no_bound_and_large_ones_do_not_tie() -> None:
    actions = Actions(Race().action_space("hare"))
    scores = np.array([[11, 12, -50], [-30, -20, -40], [1e6, 1e6, 1.5e6]], np.float32)
    assert actions.native(scores).tolist() == [3, 3, 4]
    cart, hare = race(1).layout.sides
    assert (cart.discrete, cart.action_low, cart.action_high, cart.action_limit) == (False, -1, 1, 1)
    assert (hare.discrete, hare.action_low, hare.action_high, hare.action_limit) == (
        True,
        -np.inf,
        np.inf,
        10,
    )


def test_a_choice_that_the_mask_forbids_is_never_taken() -> None:
    """The environment itself fails on one; the best of those allowed is taken."""
    space = Masked().observation_space("first")
    seat = Seat.of("first", space, Discrete(4))
    assert seat.layout(()).blocks == {"action_mask": slice(0, 4), "observation": slice(4, 6)}
    masks = np.array([[1, 1, 1, 1], [1, 0, 0, 1], [0, 1, 0, 0], [0, 0, 0, 0]], np.float32)
    observations = np.concatenate([masks, np.ones((4, 2), np.float32)], axis=1)
    scores = np.tile(np.array([[-8, -9, 5, -7]], np.float32), (4, 1))
    assert seat.native(scores, observations).tolist() == [2, 3, 1, 2]
    game = masked(8)
    game.seed(1)
    game.reset()
    rng = np.random.default_rng(0)
    for _ in range(40):
        first, second = rng.normal(size=(2, 8, 4)).astype(np.float32)
        game.reset(game.step((first, second)).done)


@pytest.mark.parametrize("choice", [0, 1, 2])
def test_views_show_scores_as_the_choice_they_are(choice: int) -> None:
    view = ParallelGameEnv(race(1))
    assert view.action_space("hare") == Discrete(3)
    view.reset(seed=0)
    _, rewards, *_ = view.step({"cart": np.zeros(2, np.float32), "hare": choice})
    assert rewards["hare"] == (choice + 2 - 3) / 2  # as Race has it, whose choices begin at 2


# --- endings


def test_the_larger_total_reward_wins() -> None:
    plan = {1: {"rewards": {"a": 3}}, 2: {"rewards": {"b": 2}}, 4: {"out": ["a", "b"]}}
    assert ending(scripted(plan), 4) == ("terminated", 0, [1000, -1000])


def test_rewards_are_the_dense_stream() -> None:
    step = last(scripted({2: {"rewards": {"a": 3, "b": -1}}}), 2)
    assert step.dense.tolist() == step.shaping.tolist() == [[3], [-1]]
    assert step.sparse.tolist() == [[0], [0]]


def test_totals_start_anew_with_each_game() -> None:
    game = scripted({1: {"rewards": {"a": 5}}, 2: {"out": ["b"]}})
    last(game, 2)
    game.reset()
    assert ending(game, 2) == ("terminated", 0, [1000, -1000])


def test_equal_totals_are_a_tie() -> None:
    plan = {1: {"rewards": {"a": 1}}, 2: {"rewards": {"b": 1}, "cut": ["a", "b"]}}
    assert ending(scripted(plan), 2) == ("truncated", NO_WINNER, [0, 0])


def test_one_agent_out_is_the_end_and_its_last_sight_stays() -> None:
    plan = {3: {"out": ["b"], "gone": ["b"], "rewards": {"a": 1}, "seen": 0.75}}
    game = scripted(plan)
    assert ending(game, 3) == ("terminated", 0, [1000, -1000])
    assert [seen[0, 0] for seen in game.observations] == [0.75, 0.5]


def test_an_agent_that_has_left_is_out() -> None:
    plan = {3: {"left": ["b"], "gone": ["b"], "rewards": {"a": 1}}}
    assert ending(scripted(plan), 3) == ("terminated", 0, [1000, -1000])


def test_agents_that_are_not_there_after_reset_are_refused() -> None:
    with pytest.raises(ConfigError, match="after reset.. its 'agents' lack 'cart'"):
        make_game("pettingzoo:games.odd_envs:Unlisted", num_envs=1)


def test_time_is_up_at_max_steps() -> None:
    game = scripted({2: {"rewards": {"b": 1}}}, max_steps=5)
    assert game.layout.max_steps == 5
    assert ending(game, 5) == ("time-up", 1, [-1000, 1000])


@pytest.mark.parametrize(
    "bad", [{"seen": np.nan}, {"seen": np.inf}, {"rewards": {"a": np.nan}}, {"rewards": {"a": 1e39}}]
)
def test_numbers_that_are_not_finite_end_that_game_as_a_tie(bad: dict[str, Any]) -> None:
    game = scripted({1: {"rewards": {"a": 1}}, 3: bad})
    step = last(game, 3)
    assert game.layout.causes[step.cause[0]] == "diverged"
    assert step.winner[0] == NO_WINNER
    assert not step.sparse.any()
    assert not step.dense.any()
    assert np.isfinite(game.observations).all()


@pytest.mark.parametrize(
    ("infos", "winner"),
    [
        ({"a": {"winner": True}}, 0),
        ({"a": {"winner": False}, "b": {"winner": np.True_}}, 1),
        ({"b": {"winner": False}}, -1),
    ],
)
def test_the_environment_may_say_who_won(infos: dict[str, Any], winner: int) -> None:
    plan = {2: {"out": ["a", "b"], "rewards": {"a": -1, "b": 0}, "infos": infos}}
    assert ending(scripted(plan, winner="info"), 2)[1] == winner


def test_an_environment_that_does_not_say_is_an_error() -> None:
    game = scripted({2: {"out": ["a", "b"]}}, winner="info")
    with pytest.raises(PluginError, match=r"winner=info.*game\.winner=reward"):
        last(game, 2)


def test_time_up_without_a_word_is_a_tie() -> None:
    assert ending(scripted(winner="info", max_steps=2), 2)[:2] == ("time-up", NO_WINNER)


# --- mistakes


@pytest.mark.parametrize(
    ("name", "kwargs", "message"),
    [
        ("pettingzoo:mpe2", {}, "expected pettingzoo:MODULE:CALLABLE"),
        ("pettingzoo::Race", {}, "expected pettingzoo:MODULE:CALLABLE"),
        ("pettingzoo:no_such_module:env", {}, "ModuleNotFoundError: No module named 'no_such_module'"),
        ("pettingzoo:games.odd_envs:Rave", {}, "has no attribute 'Rave'"),
        ("pettingzoo:games.odd_envs:UNIT", {}, "UNIT is not callable"),
        ("pettingzoo:games.odd_envs:broken_maker", {}, "cannot be made: OSError: no licence file"),
        ("pettingzoo:sys:exit", {}, "cannot be made: SystemExit"),
        ("pettingzoo:games.odd_envs:strange_maker", {}, "cannot be made: Odd: no way"),
        ("pettingzoo:games.odd_envs:no_env", {}, "expected a PettingZoo ParallelEnv, got dict"),
        ("pettingzoo:mpe2.simple_push_v3:env", {}, "played in turns; name its parallel_env"),
        ("pettingzoo:games.odd_envs:Careless", {}, "one seed gives different games"),
        (RACE, {"lenght": 3}, "cannot be made: TypeError: .*'lenght'"),
        (SCRIPTED, {"agents": ["a", "b", "c"]}, "two agents, this one 3: a, b, c"),
        (SCRIPTED, {"actions": "multi"}, "agent 'a': actions must be a Box or Discrete"),
        (MASKED, {"choices": 3}, r"agent 'first': its action_mask has 3 numbers, .* Discrete\(4\) 4 choices"),
        (MASKED, {"actions": "box"}, "agent 'first': its action_mask has 4 numbers, .* 0 choices"),
        (SCRIPTED, {"actions": "endless"}, "agent 'a': actions need finite bounds"),
        (SCRIPTED, {"plan": {2: {"raise": "kaputt"}}}, "a first trial failed: KeyError: 'kaputt'"),
    ],
)
def test_mistakes_are_one_line_before_anything_runs(name: str, kwargs: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message) as caught:
        make_game(name, num_envs=2, options={"kwargs": kwargs})
    assert str(caught.value).startswith(f"game {name}: ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"opponent_channels": {"cart": [5]}}, r"opponent_channels\.cart: 5 is outside 0–4"),
        ({"opponent_channels": {"car": [1]}}, "no agent 'car' .known: cart, hare"),
        ({"opponent_channels": {"cart": [-1]}}, r"opponent_channels\.cart\.0"),
        ({"max_steps": 0}, "max_steps"),
        ({"speed": 2}, "speed"),
    ],
)
def test_wrong_options(options: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        make_game(RACE, num_envs=1, options=options)


def test_opponent_channels_are_as_given() -> None:
    game = make_game(RACE, num_envs=1, options={"opponent_channels": {"cart": [1, 0]}})
    assert [side.opponent_channels for side in game.layout.sides] == [(0, 1), ()]


# --- workers


@pytest.mark.parametrize("threads", [1, 3])
def test_an_exception_in_an_environment_is_one_line(threads: int, capfd: Any) -> None:
    game = scripted({12: {"raise": "kaputt"}}, threads)
    with pytest.raises(PluginError, match=f"game {SCRIPTED}: step.. failed: KeyError: 'kaputt'"):
        last(game, 12)
    game.close()
    assert multiprocessing.active_children() == []
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("threads", [1, 2])
def test_what_an_environment_prints_stays_out_of_stdout(threads: int, capfd: Any) -> None:
    game = scripted({3: {"say": "agent 0 fallen"}}, threads)
    last(game, 3)
    game.close()
    printed = capfd.readouterr()
    assert printed.out == ""
    assert printed.err.count("agent 0 fallen") == 2 + threads, (
        "in the first trial, played twice, and in the games"
    )


def test_a_worker_that_dies_is_one_line(capfd: Any) -> None:
    game = scripted({12: {"exit": 1}}, threads=2)
    with pytest.raises(PluginError, match=f"game {SCRIPTED}: a worker process died"):
        last(game, 12)
    game.close()
    assert multiprocessing.active_children() == []
    assert capfd.readouterr().err == ""


def test_workers_start_late_and_end_with_close() -> None:
    game = race(5, threads=2)
    assert multiprocessing.active_children() == []
    game.reset()
    assert len(multiprocessing.active_children()) == 2
    game.close()
    game.close()
    assert multiprocessing.active_children() == []


def test_one_worker_at_most_per_game() -> None:
    game = race(2, threads=8)
    game.reset()
    assert len(multiprocessing.active_children()) == 2
    game.close()


# --- going on


def test_a_state_goes_on_with_another_number_of_workers() -> None:
    plays = [Play(started(race(5, threads=2), 3), 5)]
    plays[0].run(17)
    state = plays[0].game.state_dict()
    plays.append(Play(race(5, threads=3), 0))
    plays[1].game.load_state_dict(state)
    plays[1].rng.bit_generator.state = plays[0].rng.bit_generator.state
    plays[0].trace.clear()
    for play in plays:
        play.run(30)
        play.game.close()
    assert same(*(play.trace for play in plays))


def test_long_games_are_remembered_whole() -> None:
    options = {"kwargs": {"length": 300}}
    first, second = (make_game(RACE, num_envs=2, options=options) for _ in range(2))
    started(first, 1)
    back = np.array([[-1, -1]] * 2, np.float32), np.array([[1, 0, 0]] * 2, np.float32)
    for _ in range(150):
        first.step(back)
    second.load_state_dict(first.state_dict())
    np.testing.assert_array_equal(first.step(back).dense, second.step(back).dense)
    np.testing.assert_array_equal(first.observations[0], second.observations[0])


def test_games_that_come_out_differently_are_refused() -> None:
    game = started(race(2), 1)
    last(game, 3)
    state = game.state_dict()
    state["seeds"] = state["seeds"] + 1
    with pytest.raises(PluginError, match="cannot go on exactly"):
        race(2).load_state_dict(state)


# --- pictures


def test_pictures_have_the_size_asked_for() -> None:
    game = make_game(PUSH, num_envs=2, threads=2, options={"kwargs": {"render_mode": "rgb_array"}})
    game.reset()
    picture = game.render(1, 64, 48, ((0, 0, 255), (255, 0, 0)))
    game.close()
    assert (picture.shape, picture.dtype) == ((48, 64, 3), np.uint8)
    assert picture.std() > 0
    assert game.seconds_per_step == 0.1


def test_an_environment_that_does_not_draw_says_so() -> None:
    game = race(1)
    game.reset()
    with pytest.raises(ApilError, match=f"game {RACE}: its render.. failed: NotImplementedError"):
        game.render(0, 64, 48, ((0, 0, 255), (255, 0, 0)))


# --- the document


def test_every_option_stands_in_the_document() -> None:
    page = (Path(__file__).parents[2] / "docs" / "pettingzoo.md").read_text("utf-8")
    for key, default in PettingZooOptions().model_dump(mode="json").items():
        assert f"| `game.{key}` | `{default}` |" in page
    assert all(f"| `{cause}` |" in page for cause in race(1).layout.causes)
