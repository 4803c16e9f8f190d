"""Running statistics against numpy on all the data at once."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from apil_core import ObservationNormalizer, ReturnNormalizer
from apil_core.common.tensors import all_finite
from apil_core.training.normalize import RunningMoments


@settings(max_examples=30)
@given(st.lists(st.integers(1, 20), min_size=1, max_size=6), st.integers(0, 2**31 - 1))
def test_moments_of_chunks_equal_moments_of_all(sizes, seed):
    rows = np.random.default_rng(seed).normal(3.0, 7.0, (sum(sizes), 3)).astype(np.float32)
    moments = RunningMoments(3)
    for chunk in np.split(rows, np.cumsum(sizes)[:-1]):
        moments.update(torch.from_numpy(chunk))
    np.testing.assert_allclose(moments.mean, rows.astype(np.float64).mean(0), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(moments.var, rows.astype(np.float64).var(0), rtol=1e-8, atol=1e-9)


def test_observations_are_standardised_and_clipped():
    normalizer = ObservationNormalizer(2, clip=10.0)
    normalizer.update(torch.tensor([[0.0, 5.0], [2.0, 5.0]]))  # mean 1, std 1; mean 5, std 0
    result = normalizer(torch.tensor([[3.0, 5.0], [1e6, 6.0]]))
    torch.testing.assert_close(result, torch.tensor([[2.0, 0.0], [10.0, 10.0]]))


def test_rewards_are_divided_by_the_std_of_the_discounted_return():
    # γ = .5, two games; returns seen: step 1: [1, 3]; step 2: [.5 + 1, 1.5 + 1]
    normalizer = ReturnNormalizer(2, gamma=0.5)
    done = torch.tensor([False, False])
    normalizer.update(torch.tensor([1.0, 3.0]), done)
    result = normalizer.update(torch.tensor([1.0, 1.0]), done)
    std = np.std([1.0, 3.0, 1.5, 2.5])
    torch.testing.assert_close(result, torch.full((2,), 1.0 / float(std)))


def test_a_finished_game_restarts_its_return():
    normalizer = ReturnNormalizer(1, gamma=1.0)
    normalizer.update(torch.tensor([5.0]), torch.tensor([True]))
    normalizer.update(torch.tensor([1.0]), torch.tensor([False]))
    assert normalizer.returns.tolist() == [1.0]


def test_normalised_rewards_are_clipped():
    normalizer = ReturnNormalizer(1, gamma=0.9, clip=10.0)
    for _ in range(1000):
        normalizer.update(torch.tensor([0.001]), torch.tensor([True]))
    assert normalizer(torch.tensor([1e9])).tolist() == [10.0]


@pytest.mark.parametrize(
    ("values", "finite"),
    [
        ([1.0, -2.0], True),
        ([3e38, 3e38], True),
        ([1.0, np.nan], False),
        ([np.inf, -np.inf], False),
        ([], True),
    ],
)
def test_all_finite_is_not_fooled_by_a_sum_that_overflows(values, finite):
    assert all_finite(torch.tensor(values)) is finite


def test_a_column_and_a_long_rollout_are_counted_as_any_rows():
    rows = torch.from_numpy(np.random.default_rng(0).normal(3, 2, (1300, 3))).float()
    whole, columns = RunningMoments(3), [RunningMoments(1) for _ in range(3)]
    for part in (rows[:7], rows[7:]):
        whole.update(part)
        for i, column in enumerate(columns):
            column.update(part[:, i : i + 1])
    np.testing.assert_allclose(whole.mean, rows.double().mean(0), rtol=1e-12)
    np.testing.assert_allclose(whole.var, rows.double().var(0, correction=0), rtol=1e-12)
    np.testing.assert_allclose([float(column.var) for column in columns], whole.var, rtol=1e-12)


def test_updating_leaves_the_rows_alone():
    rows = torch.arange(6.0, dtype=torch.float64).reshape(3, 2)
    kept = rows.clone()
    RunningMoments(2).update(rows)
    assert torch.equal(rows, kept)
