"""check_game: toy-pursuit passes, and each check has a game that fails it and is told so."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from apil_core import Game, GameSpec, UnknownNameError
from apil_core.testing import ContractError, GameReport, check_game
from apil_core.testing.checks import GAME_CHECKS
from apil_core.testing.game_checks import CHECKS
from apil_core.testing.game_play import Trial
from apil_envs.toy import ToyPursuit, ToyPursuitOptions

GAMES = ["kick-and-defend", "you-shall-not-pass", "sumo-humans", "sumo-ants"]
GAMES += ["run-to-goal-humans", "run-to-goal-ants"]


def test_toy_pursuit_passes_every_check(capsys: pytest.CaptureFixture[str]) -> None:
    report = check_game("toy-pursuit")
    assert report.checked == [check.title for check in GAME_CHECKS.values()]
    assert report.skipped == []
    assert report.sides == [("evader", 7, 2), ("pursuer", 7, 2)]
    assert report.endings["time-up"] > 0
    assert capsys.readouterr().out == "", "the checkers of others stay silent"


@pytest.mark.slow
@pytest.mark.parametrize("name", GAMES)
def test_the_mujoco_games_pass_every_check(name: str) -> None:
    assert check_game(name).skipped == []


def test_a_report_is_a_short_table() -> None:
    report = GameReport("mine", ["Layout"], [], [("left", 7, 2)], 8123.4, {"caught": 3, "time-up": 6}, 0.4)
    assert str(report).splitlines() == [
        "game mine: 1 checks passed (0.4 s)",
        "  side  observation  action",
        "  left  7            2",
        "  steps per second: 8123",
        "  endings: caught 3, time-up 6",
    ]


def altered(**methods: Callable[..., Any]) -> type[Game]:
    """Toy-pursuit with some methods replaced; they get the originals' results after ``self``."""

    def replaced(name: str, change: Callable[..., Any]) -> Callable[..., Any]:
        original = getattr(ToyPursuit, name)

        def method(self: ToyPursuit, *arguments: Any) -> Any:
            return change(self, original(self, *arguments), *arguments)

        return method

    return type("Altered", (ToyPursuit,), {name: replaced(name, c) for name, c in methods.items()})


def side_with(**changes: Any) -> type[Game]:
    class Altered(ToyPursuit):
        def __init__(self, *arguments: Any, **keywords: Any):
            super().__init__(*arguments, **keywords)
            first, second = self.layout.sides
            self.layout = replace(self.layout, sides=(replace(first, **changes), second))

    return Altered


class SameBuffer(ToyPursuit):
    def step(self, actions, active=None):
        step = super().step(actions, active)
        self._buffers[1 - self._turn] = self._buffers[self._turn]
        return step


class OwnRandomness(ToyPursuit):
    def seed(self, seed):
        self._rng = np.random.default_rng()


class DependsOnThreads(ToyPursuit):
    def __init__(self, num_envs, threads=1, options=None):
        super().__init__(num_envs, threads, options)
        self.threads = threads

    def seed(self, seed):
        super().seed(seed * self.threads)


class OneSeed(ToyPursuit):
    def seed(self, seed):
        super().seed(0)


class NoClip(ToyPursuit):
    def _move(self, actions, playing):
        self._position += 0.04 * np.stack(actions) * playing[:, None]


class Crowded(ToyPursuit):
    def _move(self, actions, playing):
        super()._move(actions, playing)
        self._position += 1e-3 * np.stack(actions).mean()


class MovesAll(ToyPursuit):
    def _move(self, actions, playing):
        super()._move(actions, np.ones_like(playing))


class ResetsAll(ToyPursuit):
    def reset(self, mask=None):
        super().reset()


class ResetsNone(ToyPursuit):
    def reset(self, mask=None):
        if mask is None:
            super().reset()


class NeverRemembersEnds(ToyPursuit):
    def step(self, actions, active=None):
        step = super().step(actions, active)
        self._over[:] = False
        return step


class ForgetsRandomness(ToyPursuit):
    def load_state_dict(self, state):
        random, self._rng = self._rng, np.random.default_rng()
        super().load_state_dict(state)
        self._rng = random


class ForgetsObservations(ToyPursuit):
    def load_state_dict(self, state):
        super().load_state_dict({**state, "observations": np.zeros_like(state["observations"])})


class StepsUnstarted(ToyPursuit):
    def step(self, actions, active=None):
        self._over[:] = False
        self._clock += self._clock == 0
        return super().step(actions, active)


class ManyOnly(ToyPursuit):
    def step(self, actions, active=None):
        step = super().step(actions, active)
        return step if self.num_envs > 1 else replace(step, done=step.done[0])


def with_sparse(self, step, *_):
    return replace(step, sparse=step.sparse + np.float32(1.0))


def with_bad_cause(self, step, *_):
    return replace(step, cause=np.where(step.done, 7, -1).astype(np.int8))


def as_double(self, step, *_):
    return replace(step, dense=step.dense.astype(np.float64))


def with_nan(self, seen, *_):
    return tuple(np.full_like(o, np.nan) for o in seen)


BROKEN = [
    ("layout", side_with(opponent_channels=(2, 7)), "opponent_channels must be columns of the observation"),
    ("layout", side_with(opponent_channels=(2, 2)), "each once, got (2, 2)"),
    ("layout", side_with(blocks={"a": slice(0, 2), "b": slice(3, 7)}), "block b is 3:7, but the one before"),
    ("layout", side_with(blocks={"a": slice(0, 6)}), "blocks end at 6 of 7"),
    ("layout", side_with(name="pursuer"), "two sides with different names"),
    ("layout", side_with(action_low=1.0), "action bounds 1.0, 1.0"),
    ("arrays", altered(step=as_double), "GameStep.dense must be (2, 6) float32, got (2, 6) float64"),
    ("arrays", side_with(observation_size=8), "must be (6, 8) float32, got (6, 7) float32"),
    ("endings", altered(step=with_sparse), "sparse must be zero while a game goes on"),
    ("endings", altered(step=with_bad_cause), "cause must index the 3 causes"),
    ("seeds", OwnRandomness, "1 and 2 threads give other games"),
    ("seeds", DependsOnThreads, "1 and 2 threads give other games"),
    ("save", ForgetsRandomness, "does not go on as it did"),
    ("save", ForgetsObservations, "right after load_state_dict are not those saved"),
    (
        "save",
        altered(state_dict=lambda self, state: {**state, "rng": self._rng}),
        "must hold arrays, numbers",
    ),
    ("reset", ResetsAll, "rows outside of the mask changed"),
    ("reset", ResetsNone, "did not start anew"),
    ("inactive", MovesAll, "observations of held games changed"),
    ("ended", NeverRemembersEnds, "ended again, or was paid again"),
    ("bounds", NoClip, "not clipped"),
    ("beside", Crowded, "what other games' players do changes a game"),
    ("buffers", SameBuffer, "a step overwrites the observations handed out before it"),
    ("first", StepsUnstarted, "step() before reset() went through"),
    ("one", ManyOnly, "GameStep.done must be (1,), got ()"),
]


@pytest.mark.parametrize(("check", "game", "text"), BROKEN)
def test_a_broken_game_is_told_which_check_it_failed(check: str, game: type[Game], text: str) -> None:
    def make(num_envs: int, threads: int) -> Game:
        return game(num_envs, threads, ToyPursuitOptions(max_steps=12))

    with pytest.raises(ContractError) as caught:
        CHECKS[check](Trial("mine", make))
    message = str(caught.value)
    assert text in message
    assert message.startswith("game 'mine': ")
    assert message.endswith(f"\n  docs: {GAME_CHECKS[check].address}")


def test_starts_that_no_seed_changes_are_told_and_no_error() -> None:
    trial = Trial(
        "mine", lambda num_envs, threads: OneSeed(num_envs, threads, ToyPursuitOptions(max_steps=12))
    )
    CHECKS["seeds"](trial)
    assert trial.skipped == ["another seed: seeds 1 and 2 begin alike; a game may, if its starts are fixed"]


def test_every_check_but_the_checkers_of_others_can_be_broken() -> None:
    assert {check for check, _, _ in BROKEN} == CHECKS.keys() - {"views"}


def test_the_checkers_of_others_are_heard() -> None:
    class LooksAway(ToyPursuit):
        @property
        def observations(self):
            return with_nan(self, super().observations)

    with pytest.raises(ContractError, match="testing.md#views"):
        CHECKS["views"](Trial("mine", LooksAway))


@pytest.mark.parametrize(
    ("spec", "text"),
    [
        (GameSpec("mine", "apil_envs.toy:Nothing"), "cannot load 'apil_envs.toy:Nothing'"),
        (GameSpec("mine", "testing.test_check_game:not_a_game"), "must give an apil_core.Game, got 3"),
        (GameSpec("mine", "apil_envs.toy:ToyPursuit"), "sides of the spec are player_0, player_1"),
        (GameSpec("mine", "apil_envs.toy:ToyPursuit", victim_side=2), "victim_side must be 0 or 1, got 2"),
        (
            GameSpec(
                "mine",
                "apil_envs.toy:ToyPursuit",
                sides=("evader", "pursuer"),
                config="testing.broken_methods:Silent",
            ),
            "Silent.weight has no docstring",
        ),
    ],
)
def test_a_spec_that_is_not_sound(spec: GameSpec, text: str) -> None:
    with pytest.raises(ContractError) as caught:
        check_game(spec)
    assert text in str(caught.value)
    assert caught.value.address == "testing.md#game-spec"


def not_a_game(num_envs: int, threads: int, options: object) -> int:
    return 3


def test_a_name_that_nobody_offers() -> None:
    with pytest.raises(UnknownNameError, match="unknown game 'toy-persuit' .did you mean 'toy-pursuit'"):
        check_game("toy-persuit")
