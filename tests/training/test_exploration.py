"""Noise correlated in time: standard normal at every step, correlated as asked, anew with every game."""

from __future__ import annotations

import pytest
import torch
from helpers.small_runs import differences, final_state, small_config

from apil_core import PPOConfig, resume, run
from apil_core.training.exploration import make_noise

GAMES, HORIZON = 4000, 64
CPU = torch.device("cpu")


def drawn(steps=HORIZON, **settings):
    """(steps, n) draws of one action component."""
    torch.manual_seed(0)
    noise = make_noise(PPOConfig(**settings), GAMES, 1, HORIZON, CPU)
    return torch.stack([noise.draw() for _ in range(steps)])[..., 0]


def correlation(a, b):
    return float(torch.corrcoef(torch.stack([a, b]))[0, 1])


def test_white_noise_needs_no_memory():
    assert make_noise(PPOConfig(), GAMES, 1, HORIZON, CPU) is None


@pytest.mark.parametrize(
    "settings",
    [{"noise": "ar1"}, *({"noise": "coloured", "noise_colour": colour} for colour in (0.0, 0.5, 1.0, 2.0))],
)
def test_every_step_is_standard_normal(settings):
    draws = drawn(**settings)
    # 4000 games: a mean's standard error is .016, a standard deviation's .011; five of them, 64 steps
    assert draws.mean(1).abs().max() < 0.08
    assert (draws.std(1) - 1).abs().max() < 0.06


def test_autoregressive_noise_is_correlated_by_powers_of_rho():
    draws = drawn(noise="ar1", noise_correlation=0.8)
    for lag in (1, 2, 5):
        assert correlation(draws[10], draws[10 + lag]) == pytest.approx(0.8**lag, abs=0.05)
    assert correlation(draws[0], draws[1]) == pytest.approx(0.8, abs=0.05)  # the first is no exception


def test_coloured_noise_has_the_power_spectrum_asked_for():
    for colour in (0.0, 1.0):
        power = torch.fft.rfft(drawn(noise="coloured", noise_colour=colour), dim=0).abs().square().mean(1)
        # f and 4 f: power falls by 4^β
        assert float(power[4] / power[16]) == pytest.approx(4**colour, rel=0.15)


@pytest.mark.parametrize("kind", ["ar1", "coloured"])
def test_a_new_game_has_new_noise_and_the_others_go_on(kind):
    torch.manual_seed(0)
    noise = make_noise(PPOConfig(noise=kind, noise_correlation=0.9, noise_colour=2.0), GAMES, 1, HORIZON, CPU)
    before = noise.draw()[:, 0]
    over = torch.arange(GAMES) < GAMES // 2
    noise.renew(over)
    after = noise.draw()[:, 0]
    assert abs(correlation(before[over], after[over])) < 0.1
    assert correlation(before[~over], after[~over]) > 0.7


def test_coloured_noise_outlives_its_horizon():
    draws = drawn(steps=HORIZON + 3, noise="coloured", noise_colour=1.0)
    assert abs(correlation(draws[HORIZON - 1], draws[HORIZON])) < 0.1
    assert draws[HORIZON:].std() == pytest.approx(1.0, abs=0.06)


@pytest.mark.parametrize("kind", ["ar1", "coloured"])
def test_a_run_goes_on_exactly(tmp_path, kind):
    ppo = {"num_steps": 32, "epochs": 1, "noise": kind}
    whole = run(small_config("adrl", ppo=ppo), out=tmp_path / "whole")
    run(small_config("adrl", ppo=ppo, steps=whole.steps // 3), out=tmp_path / "parts")
    resume(tmp_path / "parts", steps=small_config().steps)
    assert differences(final_state(tmp_path / "whole"), final_state(tmp_path / "parts")) == []
