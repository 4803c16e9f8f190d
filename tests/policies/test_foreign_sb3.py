"""Agents of Stable-Baselines3 act here as they do there; and show 3: one trained, scored and attacked."""

from __future__ import annotations

import io
import json
import zipfile
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.spaces import Box, Dict, Discrete, MultiDiscrete
from helpers.small_runs import small_config

from apil_core import (
    OpponentInsideEnv,
    RunConfig,
    VictimError,
    View,
    evaluate,
    load_policy,
    make_game,
    resume,
    run,
)
from apil_core.plugins.registry import default_plugins
from apil_core.policies.conformance import check_policy
from apil_core.policies.loading import load_victim
from apil_core.training.storage.run_dir import RunDir
from policies.foreign_files import seat, view

sb3 = pytest.importorskip("stable_baselines3", reason="needs the extra sb3: pip install -e '.[sb3]'")

try:
    import sb3_contrib
except ImportError:
    sb3_contrib = None

LOW, HIGH = -0.5, 1.5
CHOICES = Discrete(3)


class Still(gymnasium.Env[Any, Any]):
    """An environment with given spaces in which nothing happens."""

    def __init__(self, observation: Any = None, action: Any = None):
        self.observation_space = observation or Box(-np.inf, np.inf, (7,), np.float32)
        self.action_space = action or Box(LOW, HIGH, (2,), np.float32)

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        return self.observation_space.sample(), {}

    def step(self, action: Any) -> Any:
        return self.observation_space.sample(), 0.0, False, False, {}


def saved(path: Path, algorithm: str, **options: Any) -> tuple[Any, str]:
    """An untrained agent, its policy shaken so that its actions differ, and its name."""
    if not (library := sb3 if hasattr(sb3, algorithm) else sb3_contrib):
        pytest.skip("needs sb3-contrib: pip install sb3-contrib")
    small = {} if algorithm in ("PPO", "A2C", "TRPO", "ARS") else {"buffer_size": 10}
    policy = options.pop("policy", "MlpPolicy")
    env = Still(options.pop("observation", None), options.pop("action", None))
    model = getattr(library, algorithm)(policy, env, device="cpu", **small, **options)
    with torch.no_grad():
        for number, parameter in enumerate(model.policy.parameters()):
            noise = torch.randn(parameter.shape, generator=torch.Generator().manual_seed(number))
            parameter.add_(0.3 * noise)
    model.save(path)
    return model, f"sb3:{path}"


def theirs(model: Any, now: View) -> torch.Tensor:
    return torch.from_numpy(model.predict(now.own.numpy(), deterministic=True)[0])


@pytest.mark.parametrize(
    ("algorithm", "kwargs"),
    [
        ("PPO", {}),
        ("PPO", {"net_arch": [5], "activation_fn": torch.nn.ReLU}),
        ("PPO", {"net_arch": {"pi": [6, 5], "vf": [4]}}),
        ("A2C", {"net_arch": []}),
        ("SAC", {"net_arch": [16, 8]}),
        ("TD3", {"net_arch": [16], "activation_fn": torch.nn.ELU}),
        ("DDPG", {"net_arch": [16, 8]}),
        ("TRPO", {}),
        ("TQC", {"net_arch": [16, 8]}),
        ("ARS", {}),
        ("ARS", {"net_arch": [5], "squash_output": False}),
        ("ARS", {"with_bias": False}),
    ],
)
def test_modes_are_those_of_stable_baselines(tmp_path: Path, algorithm: str, kwargs: dict[str, Any]) -> None:
    model, name = saved(tmp_path / "agent.zip", algorithm, policy_kwargs=kwargs)
    policy = load_policy(name)
    assert policy.info.action_bounds == (LOW, HIGH)
    decision = policy.act(view(50), sample=False)
    # Stable-Baselines3 clips what PPO and A2C give; here the game does
    torch.testing.assert_close(
        decision.action.clamp(LOW, HIGH), theirs(model, view(50)), rtol=1e-4, atol=1e-5
    )
    assert float(decision.action.std()) > 0.01


def test_a_linear_ars_is_not_squashed_and_has_no_bias(tmp_path: Path) -> None:
    model, name = saved(tmp_path / "agent.zip", "ARS", policy="LinearPolicy")
    action = load_policy(name).act(view(50), sample=True).action
    torch.testing.assert_close(action.clamp(LOW, HIGH), theirs(model, view(50)), rtol=1e-4, atol=1e-5)
    assert float(action.max()) > HIGH, "it is the game that clips"


@pytest.mark.parametrize("algorithm", ["PPO", "A2C", "DQN", "QRDQN", "ARS", "TRPO"])
def test_choices_are_those_of_stable_baselines(tmp_path: Path, algorithm: str) -> None:
    model, name = saved(tmp_path / "agent.zip", algorithm, action=CHOICES)
    policy = load_policy(name)
    assert policy.info.action_bounds == (-np.inf, np.inf)
    assert policy.info.action_size == 3
    chosen = policy.act(view(200), sample=False).action.argmax(1)
    assert torch.equal(chosen, theirs(model, view(200)))
    assert len(set(chosen.tolist())) > 1


def test_what_ppo_draws_of_choices_is_as_probable_as_there(tmp_path: Path) -> None:
    model, name = saved(tmp_path / "agent.zip", "PPO", action=CHOICES)
    own = view(1).own.expand(20_000, 7)
    many = View(own, own, torch.ones(len(own), dtype=torch.bool))
    drawn = load_policy(name).act(many, sample=True, generator=torch.Generator().manual_seed(1))
    assert drawn.distribution is None
    shares = torch.bincount(drawn.action.argmax(1), minlength=3) / len(own)
    expected = model.policy.get_distribution(own[:1]).distribution.probs[0]
    torch.testing.assert_close(shares, expected.detach(), rtol=0, atol=0.02)


@pytest.mark.parametrize("shape", ["shape", "_shape"])
def test_spaces_of_old_gym(tmp_path: Path, shape: str) -> None:
    """As Stable-Baselines3 1.0 to 1.3 wrote them with gym 0.17 to 0.19."""

    def box(size: int, bound: float) -> dict[str, Any]:
        low, high = (str(np.full(size, value, np.float32)) for value in (-bound, bound))
        kind = {":type:": "<class 'gym.spaces.box.Box'>", ":serialized:": "gASV", "dtype": "float32"}
        return {**kind, shape: [size], "low": low, "high": high, "np_random": None}

    data = {
        "policy_class": {
            ":type:": "<class 'abc.ABCMeta'>",
            "__module__": "stable_baselines3.common.policies",
        },
        "observation_space": box(2, np.inf),
        "action_space": box(1, 1.0),
        "use_sde": False,
    }
    weights = {
        "log_std": torch.tensor([0.0]),
        "mlp_extractor.shared_net.0.weight": torch.tensor([[1.0, 2.0]]),
        "mlp_extractor.shared_net.0.bias": torch.tensor([0.5]),
        "mlp_extractor.policy_net.0.weight": torch.tensor([[-1.0]]),
        "mlp_extractor.policy_net.0.bias": torch.tensor([0.0]),
        "mlp_extractor.value_net.0.weight": torch.tensor([[9.0]]),
        "mlp_extractor.value_net.0.bias": torch.tensor([9.0]),
        "action_net.weight": torch.tensor([[3.0]]),
        "action_net.bias": torch.tensor([0.25]),
        "value_net.weight": torch.tensor([[9.0]]),
        "value_net.bias": torch.tensor([9.0]),
    }
    torch.save(weights, pth := io.BytesIO())
    with zipfile.ZipFile(tmp_path / "agent.zip", "w") as archive:
        archive.writestr("data", json.dumps(data))
        archive.writestr("policy.pth", pth.getvalue())
    own = torch.tensor([[0.1, 0.2]])
    policy = load_policy(f"sb3:{tmp_path}/agent.zip")
    action = policy.act(View(own, own, torch.ones(1, dtype=torch.bool)), sample=False).action
    assert action.item() == pytest.approx(3 * np.tanh(-np.tanh(0.1 + 0.4 + 0.5)) + 0.25)
    assert policy.info.action_bounds == (-1, 1)


def test_another_policy_class_is_refused(tmp_path: Path) -> None:
    _, name = saved(tmp_path / "agent.zip", "CrossQ")
    with pytest.raises(VictimError, match=r"found one of sb3_contrib\.crossq\.policies, not supported"):
        load_policy(name)

    class Mine(sb3.ppo.MlpPolicy):
        pass

    _, name = saved(tmp_path / "mine.zip", "PPO", policy=Mine)
    with pytest.raises(VictimError, match=rf"found one of {__name__}, not supported"):
        load_policy(name)


def test_every_weight_of_the_actor_is_used(tmp_path: Path) -> None:
    model, _ = saved(tmp_path / "agent.zip", "TD3")
    model.policy.actor.add_module("extra", torch.nn.Linear(2, 2))
    model.save(tmp_path / "more.zip")
    with pytest.raises(
        VictimError, match=r"layers of MlpPolicy only, found actor\.extra\.bias, actor\.extra"
    ):
        load_policy(f"sb3:{tmp_path}/more.zip")


def test_the_spread_of_ppo_is_that_of_stable_baselines(tmp_path: Path) -> None:
    model, name = saved(tmp_path / "agent.zip", "PPO")
    decision = load_policy(name).act(view(), sample=True, generator=torch.Generator().manual_seed(1))
    with torch.no_grad():
        distribution = model.policy.get_distribution(view().own).distribution
    torch.testing.assert_close(decision.distribution.std.expand(5, 2), distribution.stddev)
    noise = torch.randn(5, 2, generator=torch.Generator().manual_seed(1))
    torch.testing.assert_close(
        decision.action, distribution.mean + distribution.stddev * noise, rtol=1e-5, atol=1e-5
    )


def test_the_spread_of_sac_is_that_of_stable_baselines(tmp_path: Path) -> None:
    model, name = saved(tmp_path / "agent.zip", "SAC")
    own = view(1).own.expand(20_000, 7)
    many = View(own, own, torch.ones(len(own), dtype=torch.bool))
    decision = load_policy(name).act(many, sample=True, generator=torch.Generator().manual_seed(1))
    assert decision.distribution is None
    with torch.no_grad():
        torch.manual_seed(0)
        raw = model.policy.actor(own, deterministic=False)
    expected = LOW + 0.5 * (raw + 1) * (HIGH - LOW)
    torch.testing.assert_close(decision.action.mean(0), expected.mean(0), rtol=0, atol=0.03)
    torch.testing.assert_close(decision.action.std(0), expected.std(0), rtol=0, atol=0.03)


def test_other_action_bounds_than_the_seats_are_an_error(tmp_path: Path) -> None:
    _, name = saved(tmp_path / "agent.zip", "PPO")
    with pytest.raises(
        VictimError, match=r"made for actions in \[-0\.5, 1\.5\], but the evader's are in \[-1, 1\]"
    ):
        check_policy(load_policy(name), seat())


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (
            {"action": MultiDiscrete([3, 2])},
            "expected a one-dimensional Box as action_space, found MultiDiscrete",
        ),
        (
            {"observation": Dict({"a": Box(-1, 1, (7,))}), "policy": "MultiInputPolicy"},
            "expected a one-dimensional Box as observation_space, found Dict",
        ),
        (
            {"observation": Box(0, 255, (3, 36, 36), np.uint8), "policy": "CnnPolicy"},
            r"as observation_space, found Box of shape \[3, 36, 36\], not supported",
        ),
        ({"use_sde": True}, "gSDE"),
        (
            {"action": Box(np.float32([-1, -2]), np.float32([1, 2]))},
            r"expected the same bounds for all actions, found \[-1\. -2\.\] to \[1\. 2\.\]",
        ),
        ({"policy_kwargs": {"activation_fn": torch.nn.Hardtanh}}, "activation Hardtanh is not supported"),
    ],
)
def test_what_is_not_supported_is_one_clear_line(
    tmp_path: Path, options: dict[str, Any], expected: str
) -> None:
    model = sb3.PPO(
        options.pop("policy", "MlpPolicy"),
        Still(options.pop("observation", None), options.pop("action", None)),
        device="cpu",
        **options,
    )
    model.save(tmp_path / "agent.zip")
    with pytest.raises(VictimError, match=expected) as caught:
        load_policy(f"sb3:{tmp_path}/agent.zip")
    assert "\n" not in str(caught.value)


def test_a_zip_without_weights(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "agent.zip", "w") as archive:
        archive.writestr("data", json.dumps({}))
    with pytest.raises(
        VictimError, match=r"expected a zip of Stable-Baselines3 .* a zip without 'policy\.pth'"
    ):
        load_policy(f"sb3:{tmp_path}/agent.zip")


@pytest.mark.parametrize("algorithm", ["PPO", "DQN"])
def test_who_learnt_to_choose_in_the_view_takes_that_seat(tmp_path: Path, algorithm: str) -> None:
    game = make_game("pettingzoo:games.odd_envs:Race", num_envs=1)
    env = OpponentInsideEnv(game, load_policy("baseline:random/5x2"))
    small: dict[str, Any] = {"n_steps": 16, "batch_size": 16} if algorithm == "PPO" else {"buffer_size": 99}
    model = getattr(sb3, algorithm)("MlpPolicy", env, device="cpu", seed=0, **small)
    model.learn(64).save(tmp_path / "hare.zip")
    policy = load_victim(f"sb3:{tmp_path}/hare.zip", game, 1, "cpu", default_plugins())
    own = torch.randn(50, 4)
    chosen = policy.act(View(own, torch.zeros(50, 5), torch.ones(50, dtype=torch.bool)), sample=False).action
    assert torch.equal(chosen.argmax(1), torch.from_numpy(model.predict(own.numpy(), deterministic=True)[0]))


# --- show 3


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """PPO of Stable-Baselines3, trained for seconds as the pursuer of toy-pursuit; its zip and model."""
    path = tmp_path_factory.mktemp("sb3") / "pursuer.zip"
    env = OpponentInsideEnv("toy-pursuit")
    model = sb3.PPO(
        "MlpPolicy", env, n_steps=512, batch_size=128, learning_rate=1e-3, gamma=0.95, seed=0, device="cpu"
    )
    model.learn(16 * 512)
    model.save(path)
    return path, model


@pytest.mark.slow
def test_an_adversary_trained_elsewhere_is_scored(trained: Any) -> None:
    path, model = trained
    result = evaluate(f"sb3:{path}", env="toy-pursuit", episodes=200, adversary_actions="mode")
    assert result.adversary.name == f"sb3:{path}"
    assert len(result.adversary.sha256) == 64
    env = OpponentInsideEnv("toy-pursuit")
    won = 0
    for game in range(100):
        observation, _ = env.reset(seed=game)
        ended = False
        while not ended:
            observation, _, ended, _, info = env.step(model.predict(observation, deterministic=True)[0])
        won += info["winner"]
    # two samples of one share, of 200 and 100 games
    assert abs(result.win_rate.value - won / 100) < 0.2
    untrained = evaluate("random", env="toy-pursuit", episodes=200)
    assert result.win_rate.value > untrained.win_rate.value + 0.1


@pytest.mark.slow
def test_an_agent_trained_elsewhere_is_attacked(trained: Any, tmp_path: Path) -> None:
    path, _ = trained
    changes: dict[str, Any] = {"victim": f"sb3:{path}", "victim_side": 1, "evaluation": {"episodes": 20}}
    result = run(small_config("e_apil", **changes), out=tmp_path / "r")
    assert result.evaluation is not None
    assert result.evaluation.victim.name == f"sb3:{path}"
    stored: RunConfig = RunDir(tmp_path / "r").config()
    assert (stored.victim, stored.victim_sha256) == (f"sb3:{path}", result.evaluation.victim.sha256)
    content = path.read_bytes()
    try:
        with zipfile.ZipFile(path, "a") as archive:
            archive.writestr("note.txt", "another agent by now")
        with pytest.raises(
            VictimError, match=r"pursuer\.zip has changed since the run began: SHA-256 \w+, expected"
        ):
            resume(tmp_path / "r", steps=8192)
        with pytest.raises(VictimError, match="has changed since the run began"):
            evaluate(tmp_path / "r", episodes=5)
    finally:
        path.write_bytes(content)
    assert resume(tmp_path / "r", steps=4096).status == "finished"
