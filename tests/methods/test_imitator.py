"""The imitator's advantages, D's penalty and the measures of quality, against hand arithmetic."""

from __future__ import annotations

import math

import pytest
import torch
from torch import nn

from apil_apil.config import DiscriminatorConfig, ImitatorConfig
from apil_apil.discriminator import Discriminator
from apil_apil.imitator import Experience, Imitator
from apil_apil.quality import prediction_quality
from apil_core import DiagonalGaussian
from methods.test_rewards import rollout_with

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
