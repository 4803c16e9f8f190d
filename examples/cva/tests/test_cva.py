"""CVA: the bonus and the mixture against hand arithmetic, what is trained and what is not, exact resume."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor

from apil_core import (
    ConfigError,
    GameLayout,
    MethodSetup,
    PPOConfig,
    Rollout,
    RunConfig,
    SideLayout,
    resume,
    run,
)
from apil_core.testing import check_method
from apil_cva.config import CuriosityConfig, CvaConfig, SurrogateConfig
from apil_cva.curiosity import Curiosity
from apil_cva.method import Cva, explained_variance
from apil_cva.surrogate import Surrogate

CPU = torch.device("cpu")


def linear_curiosity(**changes: Any) -> Curiosity:
    """f(x) = (x, 2x) and f̂(x) = (0, 0) on one number: what is left to learn is known by hand."""
    config = CuriosityConfig(**{"hidden": (), "features": 2, "normalize": False, **changes})
    made = Curiosity(1, config, 0.5, CPU)
    with torch.no_grad():
        made.target[0].weight.copy_(torch.tensor([[1.0], [2.0]]))
        made.target[0].bias.zero_()
        made.predictor[0].weight.zero_()
        made.predictor[0].bias.zero_()
    return made


def test_the_bonus_is_half_the_mean_squared_error_of_the_prediction():
    # x = 2: errors 2 and 4, ½ · (4 + 16) / 2 = 5; x = -1: errors -1 and -2, ½ · (1 + 4) / 2 = 1.25
    bonus = linear_curiosity().bonus(torch.tensor([[[2.0]], [[-1.0]]]))
    assert bonus.tolist() == [[5.0], [1.25]]


def test_the_bonus_is_divided_by_the_spread_of_its_discounted_return():
    curiosity = linear_curiosity(normalize=True)
    # one game, γ = ½, bonus 1, 2, 4, the game ends after the second step:
    # returns 1, ½ · 1 + 2 = 2.5, restart: 4; their mean is 2.5, their variance (2.25 + 0 + 2.25) / 3 = 1.5
    raw = torch.tensor([[1.0], [2.0], [4.0]])
    done = torch.tensor([[False], [True], [False]])
    torch.testing.assert_close(curiosity.normalized(raw, done), raw / 1.5**0.5)


def test_the_predictor_learns_what_it_sees_and_the_target_stays():
    curiosity = linear_curiosity(learning_rate=0.05, fraction=0.5)
    before = copy.deepcopy(curiosity.target.state_dict())
    seen = torch.linspace(-1, 1, 64).unsqueeze(-1)
    generator = torch.Generator().manual_seed(0)
    losses = [curiosity.learn(seen, 2, generator) for _ in range(20)]
    assert losses[-1] < 0.01 * losses[0]
    assert float(curiosity.bonus(seen).mean()) < 0.01
    assert all(torch.equal(value, before[name]) for name, value in curiosity.target.state_dict().items())


def test_the_surrogate_learns_the_returns_it_is_given():
    torch.manual_seed(0)
    surrogate = Surrogate(1, SurrogateConfig(learning_rate=0.02, epochs=10), CPU)
    states = torch.linspace(-1, 1, 128).unsqueeze(-1)
    targets = 3 * states[:, 0]
    for _ in range(5):
        surrogate.learn(states, targets, 2, torch.Generator().manual_seed(1))
    hidden, values = surrogate.look(states)
    assert hidden.shape == (128, 64)
    assert float((values - targets).abs().max()) < 0.3


def method(**options: Any) -> Cva:
    seat = SideLayout("seat", 2, 1, -1.0, 1.0)
    torch.manual_seed(0)
    layout = GameLayout((seat, seat), causes=("end",), max_steps=4)
    ppo = PPOConfig(gamma=0.5, lam=0.5)
    setup = MethodSetup(layout=layout, adversary_side=1, device=CPU, seed=0, ppo=ppo, methods={})
    return Cva(CvaConfig(**options), setup)


def rollout(reward: Tensor) -> Rollout:
    steps, games = reward.shape
    seen = torch.linspace(-1, 1, steps * games * 2).view(steps, games, 2)
    flags = torch.zeros(steps, games, dtype=torch.bool)
    action = torch.zeros(steps, games, 1)
    return Rollout(
        observation=seen,
        victim_observation=-seen,
        next_observation=seen[-1],
        next_victim_observation=-seen[-1],
        action=action,
        victim_action=action,
        victim_mean=None,
        victim_std=None,
        reward=reward,
        victim_reward=reward,
        normalized_reward=reward,
        normalized_victim_reward=reward,
        shaped_reward=reward,
        first=flags,
        done=flags,
    )


def test_the_three_advantages_are_mixed_with_their_weights():
    cva = method(victim_weight=2.0, curiosity_weight=0.5)
    for weights in cva.surrogate.network.parameters():  # V̂ = 0: the victim's advantage is its λ-return
        torch.nn.init.zeros_(weights)
    played = rollout(torch.tensor([[1.0, 0.0], [0.0, 4.0]]))
    streams = cva.finish_rollout(run=None, rollout=played)
    assert list(streams) == ["curiosity"]
    assert streams["curiosity"].shape == (2, 2)
    ours, bonus = torch.tensor([[1.0, -1.0], [1.0, -1.0]]), torch.tensor([[3.0, 3.0], [-3.0, -3.0]])
    mixed = cva.combine_advantages(run=None, rollout=played, streams={"reward": ours, "curiosity": bonus})
    # γλ = ¼: the victim's are 1 + ¼ · 0 = 1 and 0 + ¼ · 4 = 1 at first, then 0 and 4; their mean is 1.5 and
    # their standard deviation √((0.25 + 0.25 + 2.25 + 6.25) / 3) = √3. That of ours is √(4/3) = 2/√3.
    victim = torch.tensor([[-0.5, -0.5], [-1.5, 2.5]]) / 3**0.5
    unit = 3**0.5 / 2
    expected = ours * unit - 2.0 * victim + 0.5 * bonus.sign() * unit
    torch.testing.assert_close(mixed, expected)


@pytest.mark.parametrize(
    ("watched", "size"), [("surrogate", 5), ("adversary", 2), ("victim", 2), ("both", 4)]
)
def test_curiosity_reads_what_it_is_told_to(watched: str, size: int):
    cva = method(curiosity={"input": watched}, surrogate={"hidden": (5,)})
    played = rollout(torch.ones(2, 3))
    cva.finish_rollout(run=None, rollout=played)
    assert cva.looked.inputs.shape == (2, 3, size)
    if watched == "victim":  # the columns are mirrored, and so are their normalised values
        adversary = method(curiosity={"input": "adversary"})
        adversary.finish_rollout(run=None, rollout=played)
        torch.testing.assert_close(cva.looked.inputs, -adversary.looked.inputs)


def test_explained_variance_is_one_for_a_perfect_guess_and_zero_for_a_constant():
    returns = torch.tensor([1.0, 2.0, 3.0])
    assert explained_variance(returns, returns) == 1.0
    assert explained_variance(torch.zeros(3), returns) == 0.0
    assert explained_variance(torch.zeros(3), torch.ones(3)) == 0.0


def tiny(**changes: Any) -> RunConfig:
    base: dict[str, Any] = {
        "method": "cva",
        "env": "toy-pursuit",
        "steps": 4 * 64,
        "num_envs": 8,
        "ppo": {"num_steps": 8, "epochs": 1, "minibatches": 2},
        "evaluation": {"episodes": 0},
        "checkpoint": {"every_iterations": 2, "keep": 9},
        "recorders": (),
    }
    return RunConfig(**{**base, **changes})


@pytest.fixture(scope="module")
def straight(tmp_path_factory: pytest.TempPathFactory):
    """Four iterations in one go, and the states after two and after four."""
    out = tmp_path_factory.mktemp("cva") / "run"
    run(tiny(), out=out)
    return out, [torch.load(path, weights_only=True) for path in sorted((out / "checkpoints").glob("*.pt"))]


def differences(a: Any, b: Any, path: str = "") -> list[str]:
    if isinstance(a, dict):
        assert a.keys() == b.keys()
        return [line for key in a for line in differences(a[key], b[key], f"{path}/{key}")]
    if isinstance(a, (list, tuple)):
        return [
            line
            for i, (x, y) in enumerate(zip(a, b, strict=True))
            for line in differences(x, y, f"{path}/{i}")
        ]
    same = torch.equal(a, b) if isinstance(a, Tensor) else a == b
    return [] if same else [path]


def test_training_moves_predictor_and_surrogate_and_leaves_the_target(straight):
    _, (early, late) = straight
    moved = differences(early["methods"]["cva"], late["methods"]["cva"])
    assert not [path for path in moved if path.startswith("/curiosity/target")]
    for part in (
        "/curiosity/predictor",
        "/curiosity/optimizer",
        "/curiosity/normalizer",
        "/surrogate/network",
        "/surrogate/optimizer",
        "/sights/adversary",
    ):
        assert [path for path in moved if path.startswith(part)], part


def test_a_resumed_run_ends_where_the_straight_one_does(straight, tmp_path):
    _, (_, late) = straight
    run(tiny(steps=2 * 64), out=tmp_path / "run")
    resume(tmp_path / "run", steps=4 * 64)
    newest = max((tmp_path / "run" / "checkpoints").glob("*.pt"))
    state = torch.load(newest, weights_only=True)
    assert differences(state["methods"], late["methods"]) == []
    assert differences(state["learner"], late["learner"]) == []


def test_another_number_of_games_keeps_the_spread_and_begins_its_returns_anew():
    curiosity = linear_curiosity(normalize=True)
    ones = torch.ones(3, 2)
    curiosity.normalized(ones, torch.zeros(3, 2, dtype=torch.bool))
    other = linear_curiosity(normalize=True)
    other.load_training_state(curiosity.training_state())
    assert torch.equal(other.normalizer.returns, curiosity.normalizer.returns)
    other.normalized(torch.zeros(1, 5), torch.zeros(1, 5, dtype=torch.bool))
    assert other.normalizer.returns.tolist() == [0.0] * 5
    assert float(other.normalizer.moments.count) == 6 + 5


def test_every_option_and_its_default_stand_in_the_readme():
    page = (Path(__file__).parents[1] / "README.md").read_text("utf-8")
    rows = [line for line in page.splitlines() if line.startswith("| `")]
    for key, default in CvaConfig().model_dump(mode="json").items():
        options = (
            {f"{key}.{k}": v for k, v in default.items()} if isinstance(default, dict) else {key: default}
        )
        for name, value in options.items():
            shown = str(value).lower() if isinstance(value, bool) else str(value)
            assert any(row.startswith(f"| `{name}` | `{shown}` |") for row in rows), f"{name} = {shown}"


@pytest.mark.slow
def test_it_passes_every_check_of_a_method():
    print(check_method("cva"))


def test_an_unknown_input_is_one_line(tmp_path):
    with pytest.raises(ConfigError, match="curiosity.input"):
        run(tiny(options={"cva": {"curiosity": {"input": "ball"}}}), out=tmp_path / "run")
