"""A batch of games for other learners: Gymnasium's vector environments, its registry, Stable-Baselines3."""

from __future__ import annotations

import gc
import re
import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.spaces import Discrete
from gymnasium.utils.env_checker import check_env, data_equivalence
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers.vector import RecordEpisodeStatistics
from helpers.every_game import GAME_NAMES, short_game

import apil_core.gym
from apil_core import (
    ApilError,
    ConfigError,
    GameVectorEnv,
    OpponentInsideEnv,
    load_policy,
    make_game,
    sb3_vec_env,
)
from apil_core.common import extras
from apil_core.common.extras import install_command
from apil_core.games.two_players import TwoPlayerGames
from apil_envs.scripted import ToyEvader

gymnasium.register_envs(apil_core.gym)

RACE = "pettingzoo:games.odd_envs:Race"
IDS = {name: f"apil/{''.join(word.capitalize() for word in name.split('-'))}-v0" for name in GAME_NAMES}


def toy(num_envs: int, **options: Any) -> GameVectorEnv:
    return GameVectorEnv("toy-pursuit", num_envs=num_envs, threads=1, options=options or None)


def played(env: GameVectorEnv, steps: int, seed: int | None = 5) -> list[Any]:
    """Everything that fixed actions give."""
    env.action_space.seed(0)
    return [env.reset(seed=seed), *(env.step(env.action_space.sample()) for _ in range(steps))]


# --- the same numbers as without it


@pytest.mark.parametrize("name", GAME_NAMES)
@pytest.mark.parametrize("side", [0, 1])
def test_one_game_is_the_single_view_in_gymnasiums_own_vector(name: str, side: int) -> None:
    """Observations, rewards, endings and infos, their types and masks included."""
    ours = GameVectorEnv(short_game(name), "random", side=side)
    single = OpponentInsideEnv(short_game(name), "random", side=side)
    theirs = SyncVectorEnv([lambda: single], autoreset_mode=AutoresetMode.SAME_STEP)
    assert ours.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    assert (ours.observation_space, ours.action_space) == (theirs.observation_space, theirs.action_space)
    for seed in (5, None):
        for mine, yours in zip(played(ours, 45, seed), played(theirs, 45, seed), strict=True):
            if len(mine) == 5:  # Gymnasium's is float64
                mine = (mine[0], mine[1].astype(float), *mine[2:])
            assert data_equivalence(mine, yours, exact=True)
    ours.close()
    theirs.close()


@pytest.mark.parametrize(
    ("name", "opponent", "options"),
    [
        ("toy-pursuit", "scripted:toy-pursuit/evader/v1", {"max_steps": 7}),
        ("kick-and-defend", "embedded:kick-and-defend/kicker/v1", {}),
    ],
)
def test_many_games_are_the_batch_played_by_hand(name: str, opponent: str, options: dict[str, Any]) -> None:
    env = GameVectorEnv(name, opponent, num_envs=3, threads=2, options=options)
    game = make_game(name, num_envs=3, options=options)
    victim = load_policy(opponent)
    games, generator = TwoPlayerGames(game), torch.Generator().manual_seed(4)
    game.seed(4)
    victim.seed(4)
    games.reset()
    observations, _ = env.reset(seed=4)
    env.action_space.seed(0)
    endings = 0
    for _ in range(20):
        np.testing.assert_array_equal(observations, game.observations[1])
        actions = env.action_space.sample()
        with torch.no_grad():
            theirs = victim.act(games.view(0), sample=True, generator=generator).action
        step = games.step({0: theirs, 1: torch.from_numpy(actions)})
        observations, rewards, over, cut, infos = env.step(actions)
        np.testing.assert_array_equal(rewards, step.sparse[1] + step.dense[1])
        np.testing.assert_array_equal(over, step.done)
        assert not cut.any()
        np.testing.assert_array_equal(infos.get("_final_obs", np.zeros(3, bool)), step.done)
        for i in np.flatnonzero(over):
            endings += 1
            np.testing.assert_array_equal(infos["final_obs"][i], game.observations[1][i])
            assert infos["final_info"]["winner"][i] == (step.winner[i] == 1)
            assert infos["final_info"]["cause"][i] == game.layout.causes[step.cause[i]]
        games.reset(step.done)
    assert endings or name != "toy-pursuit"
    env.close()


def test_a_side_that_chooses_gives_integers() -> None:
    env = GameVectorEnv(RACE, "zero", side=1, num_envs=2, threads=1)
    assert env.single_action_space == Discrete(3)
    env.reset(seed=0)
    _, rewards, *_ = env.step(np.array([0, 2]))
    assert rewards.tolist() == [-0.5, 0.5]  # as Race has it: (choice + 2 - 3) / 2
    env.close()


# --- seeds, endings, options


def test_a_seed_fixes_all_games_and_the_opponents_draws() -> None:
    first, again, other = (played(toy(3), 12, seed) for seed in (1, 1, 2))
    assert data_equivalence(first, again, exact=True)
    assert not data_equivalence(first, other, exact=True)
    observations = first[0][0]
    assert len(np.unique(observations, axis=0)) == 3  # the games differ from each other
    assert not data_equivalence(played(toy(3), 2, None), played(toy(3), 2, None), exact=True)


def test_a_win_a_loss_and_a_tie_are_told_apart() -> None:
    seen: dict[str, tuple[bool, bool, float]] = {}
    env = toy(64, max_steps=40)
    observations, _ = env.reset(seed=0)
    for _ in range(120):
        towards = observations[:, 2:4] / np.abs(observations[:, 2:4]).max(1, keepdims=True)
        observations, *_, infos = env.step(towards * (np.arange(64) % 2)[:, None])  # half of them stand still
        final = infos.get("final_info", {"_cause": np.zeros(64, bool)})
        for i in np.flatnonzero(final["_cause"]):
            seen[final["cause"][i]] = (final["winner"][i], final["tie"][i], np.sign(final["sparse"][i]))
    assert seen == {
        "caught": (True, False, 1),
        "escaped": (False, False, -1),
        "time-up": (False, True, -1),  # in this game both lose then
    }


def test_gymnasiums_statistics_count_whole_games() -> None:
    env = RecordEpisodeStatistics(toy(2, max_steps=5))
    env.reset(seed=0)
    still = np.zeros((2, 2), np.float32)
    total = np.zeros(2)
    for step in range(1, 6):
        _, rewards, over, _, infos = env.step(still)
        total += rewards
        assert over.all() == (step == 5)
    assert infos["episode"]["l"].tolist() == [5, 5]
    np.testing.assert_allclose(infos["episode"]["r"], total)


def test_side_opponent_and_physics_are_options() -> None:
    env = GameVectorEnv("sumo-ants", "random", side=0, num_envs=2, options={"physics": "fast"})
    assert env.game.settings["physics"] == "fast"
    own = env.game.layout.sides[0]
    assert env.single_action_space == gymnasium.spaces.Box(
        own.action_low, own.action_high, (own.action_size,)
    )
    observations, _ = env.reset(seed=0)
    np.testing.assert_array_equal(observations, env.game.observations[0])
    faithful = GameVectorEnv("sumo-ants", "random", side=0, num_envs=2)
    assert faithful.game.settings["physics"] == "faithful"
    env.close()
    faithful.close()


def test_close_ends_the_threads() -> None:
    def threads() -> int:
        return len(list(Path("/proc/self/task").iterdir()))

    if not Path("/proc/self/task").exists():
        pytest.skip("threads are counted in /proc")
    gc.collect()  # what other tests left
    before = threads()
    env = GameVectorEnv("sumo-ants", "random", num_envs=4, threads=3)
    played(env, 2)
    assert threads() > before
    env.close()
    env.close()
    gc.collect()  # a game's physics refers to itself
    assert threads() == before


def test_pictures_of_all_games() -> None:
    env = GameVectorEnv("toy-pursuit", num_envs=2, render_mode="rgb_array")
    env.reset(seed=0)
    pictures = env.render()
    assert pictures is not None
    assert [picture.shape for picture in pictures] == [(360, 640, 3)] * 2
    assert (pictures[0] != pictures[1]).any()
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # Gymnasium's, where something is not declared
        one = gymnasium.make("apil/ToyPursuit-v0", render_mode="rgb_array")
        one.reset(seed=0)
        assert one.render().shape == (360, 640, 3)
    assert one.metadata["render_fps"] == env.metadata["render_fps"] == 20
    assert toy(2).render() is None


def test_mistakes_are_named() -> None:
    game = make_game("toy-pursuit", num_envs=2)
    with pytest.raises(ConfigError, match="needs an opponent"):
        GameVectorEnv(game)
    with pytest.raises(ConfigError, match="num_envs=3, this game has num_envs=2"):
        GameVectorEnv(game, ToyEvader(), num_envs=3)
    with pytest.raises(ConfigError, match="num_envs must be at least 1, not 0"):
        toy(0)
    with pytest.raises(ConfigError, match="side must be 0 or 1, not 2"):
        GameVectorEnv("toy-pursuit", side=2)
    with pytest.raises(ConfigError, match="baseline:zero/3x3 takes 3 observations"):
        GameVectorEnv("toy-pursuit", "baseline:zero/3x3")
    env = GameVectorEnv(game, ToyEvader())
    with pytest.raises(ConfigError, match="reset has no options, got reset_mask"):
        env.reset(options={"reset_mask": np.ones(2, bool)})
    with pytest.raises(gymnasium.error.Error, match="Seed must be a python integer"):
        env.reset(seed=[1, 2])  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match=r"shape \(2, 2\), got \(2,\)"):
        env.step(np.zeros(2))


# --- the registry


@pytest.mark.parametrize("name", GAME_NAMES)
def test_every_game_has_an_id(name: str) -> None:
    options = {"max_steps": 20} if name == "toy-pursuit" else None
    env = gymnasium.make(IDS[name], opponent="random", options=options, render_mode=None)
    assert isinstance(env.unwrapped, OpponentInsideEnv)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # it warns of infinite bounds, which are meant
        check_env(env.unwrapped)
    env.close()
    many = gymnasium.make_vec(IDS[name], num_envs=3, opponent="random", threads=1, options=options)
    assert isinstance(many, GameVectorEnv)
    assert (many.num_envs, many.single_action_space) == (3, env.action_space)
    many.close()


def test_ids_need_one_import_which_is_light() -> None:
    code = (
        "import sys, gymnasium, apil_core\n"
        "print(any(name.startswith('apil/') for name in gymnasium.registry))\n"
        "import apil_core.gym\n"
        "print(gymnasium.spec('apil/KickAndDefend-v0').kwargs)\n"
        "print(sorted({'torch', 'mujoco', 'stable_baselines3'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == ["False", "{'game': 'kick-and-defend'}", "[]"]


def test_gymnasium_imports_the_module_it_is_named_with() -> None:
    code = (
        "import gymnasium; print(gymnasium.make('apil_core.gym:apil/ToyPursuit-v0').observation_space.shape)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == ["(7,)"]


# --- Stable-Baselines3


def test_stable_baselines3_gets_the_same_games() -> None:
    pytest.importorskip("stable_baselines3", reason="needs the extra sb3: pip install -e '.[sb3]'")
    env, reference = sb3_vec_env(toy(4, max_steps=9)), toy(4, max_steps=9)
    assert env.seed(3) == [3, 4, 5, 6]
    np.testing.assert_array_equal(env.reset(), reference.reset(seed=3)[0])
    rng, ends = np.random.default_rng(0), 0
    for _ in range(40):
        actions = rng.uniform(-1, 1, (4, 2)).astype(np.float32)
        observations, rewards, dones, infos = env.step(actions)
        seen, expected, over, _, wanted = reference.step(actions)
        np.testing.assert_array_equal(observations, seen)
        np.testing.assert_array_equal(rewards, expected)
        np.testing.assert_array_equal(dones, over)
        for i in range(4):
            if not over[i]:
                assert infos[i] == {}
                continue
            ends += 1
            np.testing.assert_array_equal(infos[i]["terminal_observation"], wanted["final_obs"][i])
            assert infos[i]["TimeLimit.truncated"] is False
            assert infos[i]["is_success"] == infos[i]["winner"] == wanted["final_info"]["winner"][i]
            assert infos[i]["cause"] == wanted["final_info"]["cause"][i]
    assert ends > 4
    assert len({id(info) for info in infos}) == 4
    assert env.get_attr("render_mode") == [None] * 4
    with pytest.raises(NotImplementedError, match="one batch"):
        env.env_method("reset")
    env.close()
    with pytest.raises(ConfigError, match="SAME_STEP"):
        sb3_vec_env(SyncVectorEnv([lambda: OpponentInsideEnv("toy-pursuit")]))


def test_ppo_of_stable_baselines3_trains_reproducibly_and_logs_the_win_rate() -> None:
    pytest.importorskip("stable_baselines3", reason="needs the extra sb3: pip install -e '.[sb3]'")
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import VecMonitor, VecNormalize

    def weights() -> torch.Tensor:
        env = VecNormalize(VecMonitor(sb3_vec_env(toy(8, max_steps=9))))
        model = PPO("MlpPolicy", env, n_steps=16, batch_size=64, n_epochs=1, seed=1, device="cpu")
        model.learn(256)
        won = model.ep_success_buffer
        assert len(won) > 8
        assert {float(one) for one in won} <= {0.0, 1.0}
        assert max(episode["l"] for episode in model.ep_info_buffer) == 9
        return torch.cat([p.detach().flatten() for p in model.policy.parameters()])

    assert torch.equal(weights(), weights())


def test_a_missing_stable_baselines3_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "stable_baselines3", None)
    with pytest.raises(ApilError, match=re.escape(f"need stable-baselines3: {install_command('sb3')}")):
        sb3_vec_env(toy(2))
    assert extras.missing("stable_baselines3.common") is not None
