"""Games through the eyes of PettingZoo and Gymnasium: their own conformance tests, and ours."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import partial

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from helpers.every_game import GAME_NAMES, short_game
from pettingzoo.test import parallel_api_test, parallel_seed_test

from apil_core import (
    ConfigError,
    Decision,
    Game,
    OpponentInsideEnv,
    ParallelGameEnv,
    Policy,
    PolicyInfo,
    View,
)
from apil_envs.scripted import ToyEvader
from apil_envs.toy import ToyPursuit


def toy() -> Game:
    return ToyPursuit(num_envs=1)


class Noise(Policy):
    """Unit Gaussian actions that depend on nothing but the generator."""

    def __init__(self, observation_size: int, action_size: int):
        self.info = PolicyInfo("test:noise", "", observation_size, action_size)

    def act(self, view: View, *, sample, generator=None, activations=False) -> Decision:
        import torch

        return Decision(torch.randn((len(view.own), self.info.action_size), generator=generator))


GAMES = pytest.mark.parametrize("make", [partial(short_game, name) for name in GAME_NAMES], ids=GAME_NAMES)


@GAMES
def test_parallel_api(make: Callable[[], Game]) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        parallel_api_test(ParallelGameEnv(make()), num_cycles=60)


@GAMES
def test_parallel_seed(make: Callable[[], Game]) -> None:
    parallel_seed_test(lambda: ParallelGameEnv(make()), num_cycles=60)


@GAMES
@pytest.mark.parametrize("side", [0, 1])
def test_gymnasium_checker(make: Callable[[], Game], side: int) -> None:
    game = make()
    other = game.layout.sides[1 - side]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # it warns of infinite bounds, which are meant
        check_env(OpponentInsideEnv(game, Noise(other.observation_size, other.action_size), side=side))


def test_one_seed_one_game() -> None:
    def play(seed: int) -> list[float]:
        env = OpponentInsideEnv(toy(), ToyEvader())
        observation, _ = env.reset(seed=seed)
        numbers = list(observation)
        for _ in range(15):
            observation, reward, over, cut, _ = env.step(np.array([0.3, -0.2], np.float32))
            numbers += [*observation, reward, over, cut]
            if over:
                break
        return numbers

    assert play(1) == play(1)
    assert play(1) != play(2)


def test_reward_and_info_at_the_end() -> None:
    env = ParallelGameEnv(toy())
    env.reset(seed=0)
    still = dict.fromkeys(env.possible_agents, np.zeros(2, np.float32))
    while env.agents:
        _, rewards, terminations, truncations, infos = env.step(still)
    assert terminations == {"evader": True, "pursuer": True}
    assert truncations == {"evader": False, "pursuer": False}
    for agent, sign in (("evader", 1), ("pursuer", -1)):
        info = infos[agent]
        assert info["sparse"] == -1000
        assert info["cause"] == "time-up"
        assert info["winner"] is False
        assert sign * info["reward_move"] > 0
        assert rewards[agent] == pytest.approx(info["sparse"] + info["reward_move"])


def test_the_caller_takes_the_side_it_asks_for() -> None:
    env = OpponentInsideEnv(toy(), ToyEvader(), side=1)
    seen, _ = env.reset(seed=3)
    reference = toy()
    reference.seed(3)
    reference.reset()
    np.testing.assert_array_equal(seen, reference.observations[1][0])


def test_by_name() -> None:
    env = ParallelGameEnv("toy-pursuit", options={"max_steps": 3})
    env.reset(seed=0)
    steps = 0
    while env.agents:
        env.step(dict.fromkeys(env.agents, np.zeros(2, np.float32)))
        steps += 1
    assert steps == 3
    assert OpponentInsideEnv("toy-pursuit").reset(seed=0)[0].shape == (7,)


def test_errors_name_the_mistake() -> None:
    with pytest.raises(ConfigError, match="num_envs=2"):
        ParallelGameEnv(ToyPursuit(num_envs=2))
    with pytest.raises(ConfigError, match="opponent"):
        OpponentInsideEnv(toy())
    with pytest.raises(ConfigError, match="options"):
        ParallelGameEnv(toy(), options={"max_steps": 3})
