"""GAE and normalisation against arithmetic done by hand."""

from __future__ import annotations

import pytest
import torch

from apil_core import gae, normalize_advantages


def test_gae_by_hand():
    # one game, γ = 0.5, λ = 0.5, never ending:
    # δ2 = 3 + .5·4 − 3 = 2;  δ1 = 2 + .5·3 − 2 = 1.5;  δ0 = 1 + .5·2 − 1 = 1
    # A2 = 2;  A1 = 1.5 + .25·2 = 2;  A0 = 1 + .25·2 = 1.5
    rewards = torch.tensor([[1.0], [2.0], [3.0]])
    values = torch.tensor([[1.0], [2.0], [3.0]])
    done = torch.zeros(3, 1, dtype=torch.bool)
    result = gae(rewards, values, torch.tensor([4.0]), done, gamma=0.5, lam=0.5)
    assert result[:, 0].tolist() == [1.5, 2.0, 2.0]


def test_gae_stops_at_the_end_of_a_game():
    # the game ends with step 1: neither V_2 nor A_2 may leak into it, a time-out included
    # δ1 = 2 − 2 = 0;  A1 = 0;  δ0 = 1 + .5·2 − 1 = 1;  A0 = 1;  A2 = 3 + .5·4 − 3 = 2
    rewards = torch.tensor([[1.0], [2.0], [3.0]])
    values = torch.tensor([[1.0], [2.0], [3.0]])
    done = torch.tensor([[False], [True], [False]])
    result = gae(rewards, values, torch.tensor([4.0]), done, gamma=0.5, lam=0.5)
    assert result[:, 0].tolist() == [1.0, 0.0, 2.0]


def test_gae_keeps_games_apart():
    rewards = torch.tensor([[1.0, 5.0], [0.0, 0.0]])
    zeros = torch.zeros(2, 2)
    result = gae(rewards, zeros, torch.zeros(2), torch.zeros(2, 2, dtype=torch.bool), gamma=0.9, lam=1.0)
    assert result.tolist() == [[1.0, 5.0], [0.0, 0.0]]


def test_normalised_advantages():
    result = normalize_advantages(torch.tensor([[1.0, 2.0], [3.0, 4.0]]))
    assert float(result.mean()) == pytest.approx(0.0, abs=1e-6)
    assert float(result.std()) == pytest.approx(1.0)
