"""Networks made for one observation, as rsl_rl and Stable-Baselines3's recipe export them, in many games."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.spaces import Box, Discrete
from rsl_rl.models import MLPModel, RNNModel
from tensordict import TensorDict
from torch import Tensor, nn

from apil_core import SideLayout, VictimError, load_policy
from apil_core.policies.conformance import check_policy
from policies.foreign_files import Plain, save, seat, view

pytest.importorskip("onnxruntime", reason="needs the extra onnx: pip install -e '.[onnx]'")


def rsl_rl_model(kind: str) -> MLPModel:
    """An actor of rsl_rl with statistics of observations, in evaluation mode."""
    observations = TensorDict({"policy": torch.zeros(5, 7)}, batch_size=[5])
    recurrent: dict[str, Any] = {"rnn_type": kind, "rnn_hidden_dim": 6, "rnn_num_layers": 2}
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(4)
        model = (MLPModel if kind == "mlp" else RNNModel)(
            observations,
            {"actor": ["policy"]},
            "actor",
            2,
            hidden_dims=[8],
            obs_normalization=True,
            distribution_cfg={"class_name": "GaussianDistribution"},
            **({} if kind == "mlp" else recurrent),
        )
        model.update_normalization(TensorDict({"policy": 2 + 3 * torch.randn(64, 7)}, batch_size=[64]))
    return model.eval()


def rsl_rl_file(model: MLPModel, path: Path) -> str:
    """What its runner's ``export_policy_to_jit`` and ``export_policy_to_onnx`` write; the name for apil."""
    if path.suffix == ".pt":
        torch.jit.script(model.as_jit()).save(str(path))
        return f"torchscript:{path}"
    network: Any = model.as_onnx(verbose=False).eval()
    names = {"input_names": network.input_names, "output_names": network.output_names}
    torch.onnx.export(network, network.get_dummy_inputs(), path, opset_version=18, verbose=False, **names)
    return f"onnx:{path}"


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("suffix", [".pt", ".onnx"])
@pytest.mark.parametrize("kind", ["mlp", "lstm", "gru"])
def test_exports_of_rsl_rl_play_many_games(tmp_path: Path, kind: str, suffix: str) -> None:
    model = rsl_rl_model(kind)
    policy = load_policy(rsl_rl_file(model, tmp_path / f"policy{suffix}"), seat=seat())
    found = check_policy(policy, seat())
    assert found.recurrent == (kind != "mlp")
    saved = None
    for step in range(6):
        now = view(seed=step, first=step == 0)
        if step == 3:
            now.first = torch.tensor([False, True, False, False, True])
            model.reset(now.first)
            saved = policy.recurrent_state()
        with torch.no_grad():
            expected = model(TensorDict({"policy": now.own}, batch_size=[5]))
        torch.testing.assert_close(policy.act(now, sample=False).action, expected, rtol=0, atol=1e-6)
    if kind != "mlp":
        again = load_policy(policy.info.name, seat=seat())
        again.load_recurrent_state(saved)
        now = replace(view(seed=3), first=torch.tensor([False, True, False, False, True]))
        policy.load_recurrent_state(saved)
        assert torch.equal(again.act(now, sample=False).action, policy.act(now, sample=False).action)
        assert policy.recurrent_state()["state_0"].shape == (5, 12)
    assert policy.batch.way == "together"


class Recipe(nn.Module):
    """``OnnxableSB3Policy`` of Stable-Baselines3's guide: PPO's policy returns action, value and log_prob."""

    def __init__(self, policy: nn.Module) -> None:
        super().__init__()
        self.policy = policy

    def forward(self, observation: Tensor) -> Any:
        return self.policy(observation, deterministic=True)


class Still(gymnasium.Env[Any, Any]):
    """Spaces only."""

    def __init__(self, actions: gymnasium.Space[Any]):
        self.observation_space, self.action_space = Box(-9, 9, (7,), np.float32), actions


def sb3_network(kind: str) -> tuple[nn.Module, SideLayout, Callable[[Tensor], Tensor]]:
    """The exported module, its seat, and what it does in the seat's terms."""
    sb3 = pytest.importorskip("stable_baselines3")
    discrete = kind == "discrete"
    env = Still(Discrete(3) if discrete else Box(-1, 1, (2,), np.float32))
    if kind == "sac":
        network = Recipe(sb3.SAC("MlpPolicy", env, seed=1, device="cpu").policy.actor).eval()
        return network, seat(), network
    network = Recipe(sb3.PPO("MlpPolicy", env, seed=1, device="cpu").policy).eval()
    if not discrete:
        return network, seat(), lambda rows: network(rows)[0]
    scores = replace(seat(), action_size=3, action_low=-np.inf, action_high=np.inf)
    return network, scores, lambda rows: nn.functional.one_hot(network(rows)[0], 3).float()


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("suffix", [".pt", ".onnx"])
@pytest.mark.parametrize("kind", ["ppo", "discrete", "sac"])
def test_exports_by_the_recipe_of_stable_baselines3(tmp_path: Path, kind: str, suffix: str) -> None:
    network, place, acts = sb3_network(kind)
    path, example = tmp_path / f"net{suffix}", torch.randn(1, 7)
    if suffix == ".pt":
        traced = torch.jit.trace(network, example, check_trace=False)
        torch.jit.save(torch.jit.optimize_for_inference(torch.jit.freeze(traced)), path)
    else:
        torch.onnx.export(network, (example,), path, opset_version=18, input_names=["input"], verbose=False)
    policy = load_policy(("torchscript:" if suffix == ".pt" else "onnx:") + str(path), seat=place)
    check_policy(policy, place)
    for games in (1, 6):
        now = view(games)
        decision = policy.act(now, sample=True)
        with torch.no_grad():
            expected = acts(now.own)
        torch.testing.assert_close(decision.action, expected, rtol=0, atol=1e-6)
        assert decision.distribution is None
    assert len({tuple(row) for row in expected.tolist()}) > 1


class Flat(Plain):
    """Made for one game: a shape inside depends on it."""

    def forward(self, observation: Tensor) -> Tensor:
        return self.net(observation.reshape(7)).reshape(1, 2)


class Mixing(Plain):
    """Takes several games, and mixes them."""

    def forward(self, observation: Tensor) -> Tensor:
        return self.net(observation - observation.mean(0))


class Bare(Plain):
    """(o,) → (a,); several games would be mixed."""

    def forward(self, observation: Tensor) -> Tensor:
        assert observation.dim() == 1
        return self.net(observation / observation.sum())


@pytest.mark.parametrize("suffix", [".pt", ".pt2", ".onnx"])
@pytest.mark.parametrize("kind", [Plain, Flat, Mixing])
def test_one_by_one_unless_one_call_gives_the_same(
    tmp_path: Path, kind: type[nn.Module], suffix: str
) -> None:
    policy = load_policy(save(kind(), tmp_path / f"net{suffix}", games=1), seat=seat())
    rows = view().own
    expected = torch.cat([kind()(row[None]) for row in rows])
    torch.testing.assert_close(policy.act(view(), sample=False).action, expected, rtol=0, atol=1e-6)
    fixed = kind is not Plain or suffix == ".pt2"  # torch checks the sizes of a .pt2
    assert policy.batch.way == ("rows" if fixed else "together")
    check_policy(policy, seat())


@pytest.mark.parametrize("suffix", [".pt", ".pt2", ".onnx"])
def test_no_axis_of_games(tmp_path: Path, suffix: str) -> None:
    policy = load_policy(bare(tmp_path / f"net{suffix}"), seat=seat())
    expected = torch.stack([Bare()(row) for row in view().own])
    torch.testing.assert_close(policy.act(view(), sample=False).action, expected, rtol=0, atol=1e-6)
    assert policy.batch.way == "bare"
    check_policy(policy, seat())


def bare(path: Path) -> str:
    """:class:`Bare` in a file."""
    network, example = Bare().eval(), (torch.ones(7),)
    with warnings.catch_warnings(), torch.no_grad():
        warnings.simplefilter("ignore")
        if path.suffix == ".pt":
            torch.jit.save(torch.jit.script(network), path)
        elif path.suffix == ".pt2":
            torch.export.save(torch.export.export(network, example), path)
        else:
            torch.onnx.export(network, example, path, verbose=False)
    return {".pt": "torchscript:", ".pt2": "torch-export:", ".onnx": "onnx:"}[path.suffix] + str(path)


@pytest.mark.parametrize("suffix", [".pt2", ".onnx"])
def test_another_fixed_number_of_games_is_refused(tmp_path: Path, suffix: str) -> None:
    name = save(Plain(), tmp_path / f"net{suffix}", games=3)
    expected = (
        r"expected one or any number of games in input 'observation' .*dynamic_shapes.* found a fixed 3"
    )
    with pytest.raises(VictimError, match=expected):
        load_policy(name, seat=seat())


class Counter(Plain):
    """Its state inside is a Python number."""

    def __init__(self) -> None:
        super().__init__()
        self.steps: int = 0

    def forward(self, observation: Tensor) -> Tensor:
        self.steps += 1
        return self.net(observation) + self.steps


class Ones(Plain):
    """Its state inside does not begin as zeros."""

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer("before", torch.ones(1, 2))

    def forward(self, observation: Tensor) -> Tensor:
        self.before = self.before + self.net(observation)
        return self.before


@pytest.mark.parametrize(("network", "where"), [(Counter(), "other attributes"), (Ones(), "before")])
def test_state_inside_that_cannot_be_kept_for_each_game(
    tmp_path: Path, network: nn.Module, where: str
) -> None:
    expected = rf'expected its state as inputs and outputs of forward \("state" .* calls change in {where}$'
    with pytest.raises(VictimError, match=expected):
        load_policy(save(network, tmp_path / "net.pt"), seat=seat())


class Inside(Plain):
    """Its state inside can be kept for each game."""

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer("state", torch.zeros(1, 2))

    def forward(self, observation: Tensor) -> Tensor:
        self.state.copy_(0.5 * self.state + self.net(observation))
        return self.state + 0


@pytest.mark.parametrize("suffix", [".pt", ".pt2"])
def test_state_inside_is_kept_for_each_game(tmp_path: Path, suffix: str) -> None:
    policy = load_policy(save(Inside(), tmp_path / f"net{suffix}", games=1), seat=seat())
    state = torch.zeros(5, 2)
    for step, first in enumerate(([True] * 5, [False] * 5, [False, True, False, True, False])):
        now = replace(view(seed=step), first=torch.tensor(first))
        state[now.first] = 0
        with torch.no_grad():
            state = 0.5 * state + Plain()(now.own)
        torch.testing.assert_close(policy.act(now, sample=False).action, state, rtol=0, atol=1e-6)
    assert policy.recurrent_state()["state_0"].shape == (5, 2)


class Layered(nn.Module):
    """Two GRU layers whose state, (2, n, 5), is an input and an output."""

    def __init__(self) -> None:
        super().__init__()
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(2)
            self.gru, self.out = nn.GRU(7, 5, 2), nn.Linear(5, 2)

    def forward(self, observation: Tensor, h: Tensor) -> tuple[Tensor, Tensor]:
        x, h = self.gru(observation[None], h)
        return self.out(x[0]), h


@pytest.mark.parametrize("suffix", [".pt", ".pt2"])
def test_states_of_layers(tmp_path: Path, suffix: str) -> None:
    path, told = tmp_path / f"net{suffix}", {"apil.json": '{"state": [[2, 5]]}'}
    example = (torch.zeros(1, 7), torch.zeros(2, 1, 5))
    if suffix == ".pt":
        torch.jit.save(torch.jit.script(Layered()), path, _extra_files=told)
    else:  # its shapes say it
        torch.export.save(torch.export.export(Layered(), example), path)
    policy = load_policy(("torchscript:" if suffix == ".pt" else "torch-export:") + str(path), seat=seat())
    h = torch.zeros(2, 5, 5)
    for step, first in enumerate(([True] * 5, [False] * 5, [False, True, False, True, False])):
        now = replace(view(seed=step), first=torch.tensor(first))
        h[:, now.first] = 0
        with torch.no_grad():
            expected, h = Layered()(now.own, h)
        torch.testing.assert_close(policy.act(now, sample=False).action, expected, rtol=0, atol=1e-6)


def test_a_choice_that_the_game_does_not_have(tmp_path: Path) -> None:
    class Chooses(nn.Module):
        def forward(self, observation: Tensor) -> Tensor:
            return (observation[:, 0] > -99).long() * 4

    two = replace(seat(), action_low=-np.inf, action_high=np.inf)
    with pytest.raises(VictimError, match="expected one of 2 choices, got 4"):
        load_policy(save(Chooses(), tmp_path / "net.pt"), seat=two)
