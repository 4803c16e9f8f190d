"""IMAP's formulas by hand and against a slow reference, and the method against the whole contract."""

from __future__ import annotations

import json
import math
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from apil_core import DiagonalGaussian, MethodSetup, PPOConfig, Rollout, make_game
from apil_core.testing import check_method, tiny_config, tiny_run
from apil_imap import density
from apil_imap.config import ImapConfig, MimicConfig
from apil_imap.density import Reservoir, neighbour_distance
from apil_imap.features import Features
from apil_imap.method import STREAM, Imap
from apil_imap.mimic import Mimic
from apil_imap.risk import closeness, openings
from apil_imap.weighting import BiasReduction, expected_objective, next_multiplier, temperature

# nearest neighbours


def test_neighbour_distance_of_four_points_by_hand():
    points = torch.tensor([[0.0, 0.0], [3.0, 4.0], [0.0, 1.0], [10.0, 0.0]])
    everyone = torch.arange(4)
    # squared distances: 0–1: 25, 0–2: 1, 0–3: 100, 1–2: 18, 1–3: 65, 2–3: 101
    nearest = [1.0, math.sqrt(18), 1.0, math.sqrt(65)]
    assert neighbour_distance(points, points, 1, everyone).tolist() == pytest.approx(nearest)
    two = [(1 + 5) / 2, (math.sqrt(18) + 5) / 2, (1 + math.sqrt(18)) / 2, (math.sqrt(65) + 10) / 2]
    assert neighbour_distance(points, points, 2, everyone).tolist() == pytest.approx(two)
    # three others are all there are
    assert float(neighbour_distance(points, points, 9, everyone)[0]) == pytest.approx((1 + 5 + 10) / 3)
    # references that are none of the states count even at distance 0
    assert neighbour_distance(points, points, 1).tolist() == pytest.approx([0, 0, 0, 0], abs=1e-3)


def slow_distance(states, references, k, own):
    """The definition, one pair at a time."""
    means = []
    for i, state in enumerate(states):
        others = [
            math.dist(state, reference) for reference, row in zip(references, own, strict=True) if row != i
        ]
        means.append(sum(sorted(others)[:k]) / k)
    return means


def test_neighbour_distance_is_the_definition_across_blocks():
    rng = np.random.default_rng(0)
    states = rng.normal(size=(density._BLOCK + 60, 5)).astype(np.float32)
    old = rng.normal(size=(20, 5)).astype(np.float32)
    rows = rng.choice(len(states), size=30, replace=False)
    references = np.concatenate([old, states[rows]])
    own = np.concatenate([np.full(20, -1), rows])
    fast = neighbour_distance(*map(torch.from_numpy, (states, references)), 3, torch.from_numpy(own))
    np.testing.assert_allclose(fast.numpy(), slow_distance(states, references, 3, own), rtol=1e-4)


def test_the_reservoir_is_an_even_sample_of_all_that_was_offered():
    generator = torch.Generator().manual_seed(0)
    counts = torch.zeros(20)
    for _ in range(400):
        reservoir = Reservoir(4)
        for batch in torch.arange(20.0).view(5, 4, 1):
            own = reservoir.offer(batch, generator)
            new = own >= 0
            assert torch.equal(reservoir.states[new], batch[own[new]])
        counts[reservoir.states[:, 0].long()] += 1
    # each of 20 states is kept with probability 4/20: 80 of 400 times, standard deviation 8
    assert counts.sum() == 1600
    assert counts.min() > 80 - 4 * 8
    assert counts.max() < 80 + 4 * 8


def test_a_projection_keeps_squared_distances_in_expectation():
    torch.manual_seed(0)
    x, y = torch.randn(2, 200, 384)
    features = Features(384, 64)
    ratio = (features(x) - features(y)).square().sum(-1) / (x - y).square().sum(-1)
    # the squared length of a projection to p has mean 1 and standard deviation √(2/p) = 0.177
    assert float(ratio.mean()) == pytest.approx(1, abs=0.05)
    assert float(ratio.std()) == pytest.approx(math.sqrt(2 / 64), abs=0.04)
    assert Features(7, 64).matrix is None
    assert Features(384, 0).size == 384


# risk, divergence


def test_openings_are_carried_until_a_game_begins():
    states = torch.tensor([[[1.0], [2.0]], [[3.0], [4.0]], [[5.0], [6.0]]])
    first = torch.tensor([[False, True], [True, False], [False, False]])
    carried = torch.tensor([[9.0], [8.0]])
    assert openings(states, first, carried)[..., 0].tolist() == [[9, 2], [3, 2], [3, 2]]
    assert openings(states, first, None)[..., 0].tolist() == [[1, 2], [3, 2], [3, 2]]
    assert float(closeness(torch.tensor([4.0, 6.0]), torch.tensor([1.0, 2.0]))) == -5.0


def test_the_divergence_of_two_gaussians_by_hand():
    mimic = Mimic(3, 1, MimicConfig(), init_std=1.0)
    with torch.no_grad():
        mimic.policy.body[-1].weight.zero_()
    acted = DiagonalGaussian(torch.tensor([[1.0]]), torch.tensor([[2.0]]))
    # KL(N(1, 2²) ‖ N(0, 1)) = ln(1/2) + (2² + 1²)/2 − 1/2
    kl = math.log(0.5) + 2.5 - 0.5
    assert mimic.divergence(acted, torch.randn(1, 3)).tolist() == pytest.approx([kl], rel=1e-5)


def test_the_mimic_follows_slowly():
    torch.manual_seed(0)
    mimic = Mimic(3, 2, MimicConfig(learning_rate=1e-2), init_std=1.0)
    states, generator = torch.randn(256, 3), torch.Generator().manual_seed(0)
    acted = DiagonalGaussian(states[:, :2].clone(), torch.full((256, 2), 0.5))
    losses = [mimic.learn(acted, states, generator) for _ in range(8)]
    assert losses == sorted(losses, reverse=True)
    assert 0 < losses[-1] < losses[0] / 2


# bias reduction


def test_the_multiplier_and_the_temperature_by_hand():
    assert expected_objective(0.5, 1.2) == pytest.approx(0.6)
    assert expected_objective(0.9, 1.2, 1.0) == 1.0
    assert expected_objective(-6.0, 1.2) == pytest.approx(-5.0)
    # 0.4 where 0.6 was expected: 0 + 10 · 0.2
    assert next_multiplier(0.0, 0.4, 0.6, 10.0) == pytest.approx(2.0)
    assert next_multiplier(1.0, 0.65, 0.6, 10.0) == pytest.approx(0.5)
    assert next_multiplier(1.0, 0.9, 0.6, 10.0) == 0.0
    assert temperature(1.0, 2.0) == pytest.approx(1 / 3)
    assert temperature(0.5, 0.0) == 0.5


def test_bias_reduction_over_three_iterations():
    weighting = BiasReduction(ImapConfig())
    weights = []
    for objective in (0.5, 0.4, 0.6):
        weighting.update(objective)
        weights.append(weighting.weight)
    # λ: 0 (nothing to compare with); 10 · (0.6 − 0.4) = 2; 2 − 10 · (0.6 − 0.48) = 0.8
    assert weights == pytest.approx([1, 1 / 3, 1 / 1.8])
    without = BiasReduction(ImapConfig(bias_reduction=False, tau=0.7))
    without.update(0.5)
    without.update(0.1)
    assert without.weight == 0.7


# the method


def imap(**options):
    layout = make_game("toy-pursuit", num_envs=1, threads=1).layout
    torch.manual_seed(0)
    return Imap(ImapConfig(**options), MethodSetup(layout, 1, torch.device("cpu"), 0, PPOConfig(), {}))


def rollout(seed, steps=3, games=4):
    g = torch.Generator().manual_seed(seed)
    normal = lambda *shape: torch.randn(steps, games, *shape, generator=g)  # noqa: E731
    flags = torch.zeros(steps, games, dtype=torch.bool)
    rewards = dict.fromkeys(
        ["reward", "victim_reward", "normalized_reward", "normalized_victim_reward", "shaped_reward"],
        torch.zeros(steps, games),
    )
    return Rollout(
        observation=normal(7),
        victim_observation=3 * normal(7),
        next_observation=normal(7)[0],
        next_victim_observation=normal(7)[0],
        action=normal(2),
        victim_action=normal(2),
        victim_mean=None,
        victim_std=None,
        first=flags,
        done=flags,
        **rewards,
    )


def run_stub():
    return SimpleNamespace(generator=torch.Generator().manual_seed(0))


def slow_features(raws):
    """Each rollout's states, normalised with the statistics of all rollouts up to it."""
    flat = [raw.flatten(0, 1).double().numpy() for raw in raws]
    result = []
    for i, rows in enumerate(flat):
        seen = np.concatenate(flat[: i + 1])
        result.append((rows - seen.mean(0)) / np.sqrt(seen.var(0) + 1e-8))
    return result


@pytest.mark.parametrize("bonus", ["state_coverage", "policy_coverage"])
def test_coverage_is_the_definition_with_xi_between_the_sides(bonus):
    method, run, rollouts = imap(bonus=bonus, xi=0.25, neighbours=2), run_stub(), [rollout(1), rollout(2)]
    streams = [method.finish_rollout(run=run, rollout=r)[STREAM] for r in rollouts]
    expected = np.zeros(12)
    for weight, side in ((0.75, "observation"), (0.25, "victim_observation")):
        first, second = slow_features([getattr(r, side) for r in rollouts])
        everyone = second if bonus == "state_coverage" else np.concatenate([first, second])
        own = np.arange(len(everyone)) - (len(everyone) - 12)  # those of the first rollout come out below 0
        expected += weight * np.log1p(slow_distance(second, everyone, 2, own))
    ratio = streams[1].flatten().numpy() / expected
    np.testing.assert_allclose(ratio, ratio.mean(), rtol=1e-3)  # in units of its return's spread
    metrics = method.update_auxiliary(run=run, rollout=rollouts[1])
    assert metrics["bonus"] == pytest.approx(expected.mean(), rel=1e-4)


def test_both_advantages_count_alike_and_the_mixture_is_normalised():
    method = imap(bias_reduction=False, tau=0.5)
    reward, bonus = torch.tensor([[1.0, -1.0, 1.0, -1.0]]), torch.tensor([[300.0, 300.0, 100.0, 100.0]])
    mixed = method.combine_advantages(run=None, rollout=None, streams={"reward": reward, STREAM: bonus})
    # both become ±√(3/4); 1·± + ½·± = ±1.5, ±0.5 up to a factor; then standard deviation 1
    sum_ = np.array([1.5, -0.5, 0.5, -1.5])
    assert mixed[0].tolist() == pytest.approx((sum_ / sum_.std(ddof=1)).tolist(), rel=1e-5)
    as_is = imap(bias_reduction=False, tau=0.5, normalize="sum")
    mixed = as_is.combine_advantages(run=None, rollout=None, streams={"reward": reward, STREAM: bonus})
    sum_ = np.array([151.0, 149.0, 51.0, 49.0]) - 100
    assert mixed[0].tolist() == pytest.approx((sum_ / sum_.std(ddof=1)).tolist(), rel=1e-5)


def test_a_run_lowers_the_weight_by_its_own_win_rate(tmp_path):
    options = {"imap": {"min_games": 1, "references": 64}}
    tiny_run(tiny_config("imap", options=options, steps=4 * 512), tmp_path / "r")
    rows = [json.loads(line) for line in (tmp_path / "r" / "metrics.jsonl").read_text().splitlines()]
    last, multiplier = None, 0.0
    for row in rows:
        if row["games"]:
            rate = row["cause/caught"] / row["games"]
            if last is not None:
                goal = min(1.2 * last, 1.0)
                multiplier = max(multiplier - 10 * (rate - goal), 0.0)
            last = rate
        assert row["imap/objective"] == pytest.approx(last or 0.0)
        assert row["imap/multiplier"] == pytest.approx(multiplier)
        assert row["imap/temperature"] == pytest.approx(1 / (1 + multiplier))
        assert "ppo/value_intrinsic" in row
    assert multiplier > 0


def test_mistaken_options_are_told():
    with pytest.raises(ValueError, match=r"references \(10\) must be more than neighbours \(10\)"):
        ImapConfig(references=10)


def test_policy_coverage_passes_every_check_of_a_method():
    print(check_method("imap"))


@pytest.mark.slow
@pytest.mark.parametrize("bonus", ["state_coverage", "risk", "divergence"])
def test_the_other_bonuses_do_too(bonus):
    print(check_method("imap", options={"bonus": bonus}))
