"""The trust-region step and the imitator's updates."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from apil_apil.config import DiscriminatorConfig, ImitatorConfig
from apil_apil.discriminator import Discriminator
from apil_apil.imitator import Experience, Imitator
from apil_apil.trpo import TrustRegion, conjugate_gradient, trpo_step
from apil_core import GaussianActor


def test_conjugate_gradient_solves():
    torch.manual_seed(0)
    root = torch.randn(6, 6, dtype=torch.float64)
    matrix = root @ root.T + torch.eye(6, dtype=torch.float64)
    b = torch.randn(6, dtype=torch.float64)
    x = conjugate_gradient(lambda v: matrix @ v, b, 20)
    torch.testing.assert_close(matrix @ x, b)


def problem(seed, rows=512):
    torch.manual_seed(seed)
    policy = GaussianActor(5, 3, (16,), init_std=0.7)
    observations = torch.randn(rows, 5)
    with torch.no_grad():
        old = policy(observations)
        actions = old.sample()
    advantages = torch.randn(rows)

    def surrogate(new, old):
        return ((new.log_prob(actions) - old.log_prob(actions)).exp() * advantages).mean()

    return policy, observations, surrogate, old


@settings(max_examples=15)
@given(st.integers(0, 1000), st.sampled_from([0.001, 0.01, 0.05]))
def test_kl_stays_in_the_region_and_the_surrogate_improves(seed, kl):
    policy, observations, surrogate, old = problem(seed)
    before = float(surrogate(old, old))
    metrics = trpo_step(policy, observations, surrogate, TrustRegion(kl=kl), torch.arange(512))
    with torch.no_grad():
        new = policy(observations)
    assert metrics["accepted"] == 1.0
    assert 0.0 < float(old.kl(new).mean()) <= kl
    assert float(surrogate(new, old)) > before
    # a natural-gradient step uses the region, it does not just stay inside it
    assert float(old.kl(new).mean()) > kl / 10


def test_a_hopeless_step_leaves_the_policy_alone():
    policy, observations, _, _ = problem(0)
    before = [p.clone() for p in policy.parameters()]
    metrics = trpo_step(
        policy,
        observations,
        lambda new, old: 0.0 * (new.mean.sum() + new.std.sum()),
        TrustRegion(),
        torch.arange(512),
    )
    assert metrics["accepted"] == 0.0
    assert all(torch.equal(a, b) for a, b in zip(before, policy.parameters(), strict=True))


def test_fisher_product_is_the_hessian_of_kl():
    # one parameter: the mean of a unit Gaussian. KL = ½ (μ − μ')², Hessian 1, plus damping .1
    from apil_apil.trpo import _fisher_product
    from apil_core import DiagonalGaussian

    mean = torch.nn.Parameter(torch.tensor([0.3]))

    def policy(rows):
        return DiagonalGaussian(mean.expand(len(rows), 1), torch.ones(1))

    product = _fisher_product(policy, [mean], torch.zeros(4, 1), 0.1)
    torch.testing.assert_close(product(torch.tensor([2.0])), torch.tensor([2.2]))


@pytest.mark.parametrize("update", ["trpo", "ppo"])
def test_the_imitator_learns_what_pays(update):
    """Paid for −(a − s)², it must come to predict s."""
    torch.manual_seed(1)
    config = ImitatorConfig(update=update, init_std=0.5, kl=0.05, learning_rate=3e-3, minibatches=4)
    imitator = Imitator(1, 1, config, per_step=True, stream_discount=(0.99, 0.95))
    generator = torch.Generator().manual_seed(0)
    states = torch.rand(16, 64, 1) * 2 - 1

    def error():
        with torch.no_grad():
            return float((imitator(states).mean - states).square().mean())

    before = error()
    for _ in range(25):
        with torch.no_grad():
            actions = imitator(states).sample(generator)
        rewards = -(actions - states).square()[..., 0]
        done = torch.ones(16, 64, dtype=torch.bool)
        flat = states.flatten(0, 1), actions.flatten(0, 1)
        metrics = imitator.learn(Experience(states, states[-1], actions, done, *flat, rewards), generator)
        if update == "trpo":
            assert metrics["imitator_kl"] <= 0.05
    assert error() < 0.3 * before


@pytest.mark.parametrize(("bound", "lowest", "highest"), [("tanh", 0.26894, 0.73106), ("none", 0.0, 1.0)])
def test_range_of_d(bound, lowest, highest):
    torch.manual_seed(0)
    d = Discriminator(4, 2, DiscriminatorConfig(logit_bound=bound))
    with torch.no_grad():
        (logits,) = d.logits(torch.randn(1000, 4) * 1e4, torch.randn(1000, 2) * 1e4)
    probability = torch.sigmoid(logits)
    assert float(probability.min()) >= lowest - 1e-4
    assert float(probability.max()) <= highest + 1e-4


def test_split_first_layer_equals_one_on_the_concatenation():
    torch.manual_seed(0)
    d = Discriminator(4, 2, DiscriminatorConfig(hidden=(8, 8), logit_bound="none"))
    state, action = torch.randn(5, 4), torch.randn(5, 2)
    weight = torch.cat([d.state.weight, d.action.weight], dim=1)
    whole = d.head(torch.cat([state, action], 1) @ weight.T + d.state.bias)[:, 0]
    torch.testing.assert_close(d.logits(state, action)[0], whole)
