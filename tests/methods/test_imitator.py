"""The imitator's advantages, D's penalty and the measures of quality, against hand arithmetic."""

from __future__ import annotations

import math
from types import SimpleNamespace

import pytest
import torch
from torch import nn

from apil_apil import discriminator
from apil_apil.config import DiscriminatorConfig, ImitatorConfig
from apil_apil.discriminator import Discriminator
from apil_apil.imitator import Experience, Imitator
from apil_apil.method import Games
from apil_apil.quality import prediction_quality
from apil_core import ConfigError, DiagonalGaussian, PluginError, RunConfig
from apil_core.plugins.registry import default_plugins
from apil_core.training.build import build_hooks
from methods.test_rewards import rollout_with, setup_of

REWARDS, STREAM, BETA, GAMMA = (1.0, 2.0, 6.0), (0.0, 0.0, -1.0), 0.5, 0.5


def normalized(values):
    """To mean 0 and standard deviation 1 (n − 1)."""
    mean = sum(values) / len(values)
    spread = math.sqrt(sum((v - mean) ** 2 for v in values) / (len(values) - 1))
    return [(v - mean) / spread for v in values]


def imitator(*, per_step, **settings):
    """One whose critics say 0 everywhere, so that an advantage is the return itself."""
    config = ImitatorConfig(gamma=GAMMA, lam=1.0, **settings)
    made = Imitator(3, 2, config, per_step=per_step, stream_discount=(GAMMA, 1.0))
    made.open_stream("adversary")
    for critic in (made.critic, made.stream_critics["adversary"]):
        nn.init.zeros_(critic.body[-1].weight)
    return made


def experience(rewards, streams=None, likelihood_weight=0.0):
    """One game of three steps, over at its end."""
    return Experience(
        states=torch.randn(3, 1, 3),
        next_states=torch.randn(1, 3),
        actions=torch.randn(3, 1, 2),
        done=torch.tensor([[False], [False], [True]]),
        victim_states=torch.randn(3, 3),
        victim_actions=torch.randn(3, 2),
        rewards=None if rewards is None else torch.tensor(rewards).view(3, 1),
        streams=streams or {},
        likelihood_weight=likelihood_weight,
    )


def test_credit_per_step_is_each_reward_for_itself_and_the_stream_discounted():
    stream = {"adversary": (BETA, torch.tensor(STREAM).view(3, 1))}
    got = imitator(per_step=True).advantages(experience(REWARDS, stream))
    # the stream's returns from the last step back: −1, 0 − 1/2, 0 − 1/4
    both = zip(normalized(REWARDS), normalized((-0.25, -0.5, -1.0)), strict=True)
    expected = [a + BETA * b for a, b in both]
    assert got.flatten().tolist() == pytest.approx(expected, abs=1e-5)


def test_credit_for_the_return_is_all_that_follows():
    got = imitator(per_step=False).advantages(experience(REWARDS))
    # 6; 2 + 6/2 = 5; 1 + 5/2 = 3.5
    assert got.flatten().tolist() == pytest.approx(normalized((3.5, 5.0, 6.0)), abs=1e-5)


def test_a_baseline_of_the_immediate_reward_is_subtracted():
    made = imitator(per_step=True)
    nn.init.constant_(made.critic.body[-1].bias, 100.0)
    got = made.advantages(experience(REWARDS))
    assert got.flatten().tolist() == pytest.approx(normalized(REWARDS), abs=1e-4)
    # and it is fitted to the reward itself, not to a return
    assert made.critic._targets.tolist() == pytest.approx(REWARDS, abs=1e-4)


def test_with_nothing_paid_there_is_no_policy_gradient():
    assert imitator(per_step=True).advantages(experience(None)) is None


@pytest.mark.parametrize("update", ["ppo", "trpo"])
def test_the_likelihood_alone_raises_the_likelihood(update):
    torch.manual_seed(0)
    made = imitator(per_step=True, update=update, objective="likelihood", fisher_fraction=1.0)
    seen = experience(None, likelihood_weight=1.0)

    def likelihood():
        with torch.no_grad():
            return float(made.policy(seen.victim_states).log_prob(seen.victim_actions).mean())

    before = likelihood()
    for _ in range(20):
        made.learn(seen, torch.Generator().manual_seed(0))
    assert likelihood() > before + 0.05


def test_the_gradient_penalty_by_hand():
    config = DiscriminatorConfig(hidden=(1,), logit_bound="none", gradient_penalty=3.0)
    made = Discriminator(1, 1, config)
    with torch.no_grad():
        made.state.weight.fill_(0.5)
        made.action.weight.fill_(2.0)
        made.head[1].weight.fill_(1.5)
    point = torch.tensor([[0.4]]), torch.tensor([[0.3]])
    slope = 1.5 * (1 - math.tanh(0.5 * 0.4 + 2.0 * 0.3) ** 2) * 2.0
    got = made._penalty(point, point, torch.Generator())
    assert float(got.detach()) == pytest.approx(3.0 * slope**2, rel=1e-5)


def test_shares_of_what_can_be_predicted():
    # actions 0, 4: the best constant, 2, errs by 4; the victim's mean by 1; this prediction by (1 + 4) / 2
    rollout = rollout_with([[0.0, 0.0]])
    rollout.victim_action = torch.tensor([[[0.0], [4.0]]])
    rollout.victim_mean = torch.tensor([[[1.0], [3.0]]])
    prediction = DiagonalGaussian(torch.tensor([[[1.0], [2.0]]]), torch.ones(1))
    quality = prediction_quality(prediction, rollout)
    assert quality["relative_error"] == pytest.approx(2.5 / 4)
    assert quality["explained_share"] == pytest.approx((4 - 2.5) / (4 - 1))
    assert quality["log_likelihood"] == pytest.approx(-0.5 * 2.5 - 0.5 * math.log(2 * math.pi))
    rollout.victim_mean = None  # a black box
    assert "explained_share" not in prediction_quality(prediction, rollout)


def method_of(name, **options):
    config = RunConfig(method=name, env="toy-pursuit", options=options)
    methods, hooks = build_hooks(config, default_plugins(), setup_of(config))
    return methods["apil"], SimpleNamespace(config=config, hook=hooks.hook, steps=0, iteration=0)


@pytest.mark.parametrize(("objective", "of_d"), [("gail", 1.0), ("likelihood", 0.0)])
def test_credit_return_pays_the_published_reward(monkeypatch, objective, of_d):
    """η = log D − β·r̂^α in one reward; without log D where D does not pay."""
    apil, run = method_of(
        "e_apil", e_apil={"beta": 0.5}, apil={"imitator": {"credit": "return", "objective": objective}}
    )
    rollout = rollout_with([[0.0, 2.0, -3.0]])
    rollout.done = torch.zeros(1, 3, dtype=torch.bool)
    rollout.next_victim_observation = rollout.next_observation = torch.zeros(3, 3)
    games = Games(rollout, torch.zeros(1, 3, 3), torch.zeros(1, 3, 3), torch.zeros(1, 3, 2))
    logits = torch.tensor([[0.0, 1.0, -1.0]])
    monkeypatch.setattr(apil, "_update_discriminator", lambda *given: ({}, logits))
    seen = []
    monkeypatch.setattr(apil.imitator, "learn", lambda experience, generator: seen.append(experience) or {})
    run.generator = None
    metrics = apil._learn(run, games, games, apil._streams(run, rollout))
    log_d = [math.log(1 / (1 + math.exp(-x))) for x in (0.0, 1.0, -1.0)]
    expected = [of_d * d - 0.5 * r for d, r in zip(log_d, (0.0, 2.0, -3.0), strict=True)]
    assert seen[0].rewards.flatten().tolist() == pytest.approx(expected)
    assert seen[0].streams == {}
    assert metrics["imitation_reward"] == pytest.approx(sum(expected) / 3, abs=1e-6)


def test_the_weight_of_the_likelihood_halves_down_to_its_floor():
    config = {"objective": "both", "likelihood_weight": 0.8, "likelihood_half_life": 100.0}
    apil, _ = method_of("apil", apil={"imitator": config})
    assert [apil._likelihood_weight(steps) for steps in (0, 100, 200, 10**6)] == [0.8, 0.4, 0.2, 0.1]
    assert method_of("apil")[0]._likelihood_weight(0) == 0.0
    assert method_of("apil", apil={"imitator": {"objective": "likelihood"}})[0]._likelihood_weight(9) == 1.0


def test_the_logit_is_the_sum_of_both_published_rewards():
    logits = torch.tensor([[0.3, -2.0]])
    rewards = discriminator.REWARDS
    both = rewards["log_d"](logits) + rewards["neg_log_1md"](logits)
    torch.testing.assert_close(rewards["logit"](logits), both)


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (3, r"must return {name: \(weight, reward\)} or None"),
        ({"x": torch.zeros(2, 2)}, "or None"),
        ({"x": (1.0, 3)}, "'x' must have a tensor as its reward, got int"),
        ({"x": (1.0, torch.zeros(2))}, r"'x' must be \(1, 3\) torch.float32 on cpu, got \(2,\)"),
        ({"x": (1.0, torch.zeros(1, 3, dtype=torch.float64))}, "torch.float64"),
        ({"x": (math.nan, torch.zeros(1, 3))}, "NaN or infinite"),
        ({"x": (1.0, torch.full((1, 3), math.inf))}, "NaN or infinite"),
    ],
)
def test_a_stream_that_cannot_be_learnt_from_is_one_line(answer, message):
    apil, run = method_of("apil")
    run.hook = SimpleNamespace(imitation_streams=lambda **given: [answer])
    rollout = rollout_with([[0.0, 0.0, 0.0]])
    rollout.done = torch.zeros(1, 3, dtype=torch.bool)
    with pytest.raises(PluginError, match=message):
        apil._streams(run, rollout)


def test_streams_may_have_any_name_and_keep_it():
    apil, run = method_of("apil")
    rollout = rollout_with([[0.0, 0.0, 0.0]])
    rollout.done = torch.zeros(1, 3, dtype=torch.bool)
    names = {"a.b": 1.0, "values": 2.0}
    run.hook = SimpleNamespace(
        imitation_streams=lambda **given: [{n: (w, rollout.normalized_reward) for n, w in names.items()}]
    )
    assert list(apil._streams(run, rollout)) == ["a.b", "values"]
    again, _ = method_of("apil")
    again.load_state_dict(apil.state_dict())
    assert list(again.imitator.stream_critics) == ["a.b", "values"]
    del names["values"]
    run.iteration = 1
    with pytest.raises(PluginError, match="names changed"):
        apil._streams(run, rollout)
    run.iteration = 0  # of another run, initialised from the first
    assert list(again._streams(run, rollout)) == list(again.imitator.stream_critics) == ["a.b"]


def test_a_rollout_after_its_first_step():
    rollout = rollout_with([[1.0, 2.0], [3.0, 4.0]])
    rollout.next_observation = torch.ones(2, 3)
    rollout.groups = {"x": torch.tensor([[5.0], [6.0]])}
    rest = rollout.after(1)
    assert rest.normalized_reward.tolist() == [[3.0, 4.0]]
    assert rest.groups["x"].tolist() == [[6.0]]
    assert rest.next_observation is rollout.next_observation


def test_own_rollouts_of_one_step_are_refused():
    config = RunConfig(method="apil", env="toy-pursuit", options={"apil": {"rollouts": "own"}})
    config = config.model_copy(update={"ppo": config.ppo.model_copy(update={"num_steps": 1})})
    with pytest.raises(ConfigError, match=r"ppo\.num_steps: 1"):
        build_hooks(config, default_plugins(), setup_of(config))
