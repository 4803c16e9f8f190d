"""Every method beats the toy victim significantly more often after training than before."""

from __future__ import annotations

import pytest
from helpers.small_runs import metrics_of

from apil_core import evaluate, run
from apil_core.common.statistics import difference
from apil_core.testing import tiny_config

STEPS = {"adrl": 45_000, "apl": 90_000, "apil": 90_000, "e_apil": 130_000}
EPISODES = 300


def learning_config(method, steps):
    return tiny_config(
        method,
        steps=steps,
        num_envs=64,
        ppo={"num_steps": 64, "epochs": 10, "minibatches": 4, "learning_rate": 1e-3},
        checkpoint={"every_iterations": 1000},
    )


_SLOW = ("apl", "apil", "e_apil")  # half a minute each


@pytest.mark.parametrize(
    "method", [pytest.param(name, marks=[pytest.mark.slow] if name in _SLOW else []) for name in STEPS]
)
def test_training_raises_the_win_rate(tmp_path, method):
    run(learning_config(method, 1), out=tmp_path / "before")
    run(learning_config(method, STEPS[method]), out=tmp_path / "after")
    before, after = (evaluate(tmp_path / name, episodes=EPISODES, seed=1) for name in ("before", "after"))
    gain = difference(after.wins, EPISODES, before.wins, EPISODES)
    assert gain.low > 0.1, f"{before.win_rate} → {after.win_rate}"
    if method == "e_apil":
        last = metrics_of(tmp_path / "after")[-5:]
        for ours, constant, sign in (
            ("mse", "constant_mse", -1),
            ("log_likelihood", "constant_log_likelihood", 1),
        ):
            gains = [sign * (m[f"apil/{ours}"] - m[f"apil/{constant}"]) for m in last]
            assert min(gains) > 0, f"{ours} is no better than the best constant: {gains}"


@pytest.mark.parametrize(
    "objective", ["gail", *(pytest.param(name, marks=pytest.mark.slow) for name in ("likelihood", "both"))]
)
def test_the_imitator_beats_the_best_constant(tmp_path, objective):
    """By a margin: the constant is fitted to the very actions, the imitator has not seen them."""
    options = {"apil": {"imitator": {"objective": objective}}}
    config = tiny_config("apil", steps=25 * 2048, ppo={"num_steps": 64}, options=options)
    run(config, out=tmp_path / "r")
    last = metrics_of(tmp_path / "r")[-5:]
    assert sum(m["apil/relative_error"] for m in last) / 5 < 0.9
    assert sum(m["apil/explained_share"] for m in last) / 5 > 0.3


@pytest.mark.slow
def test_the_discriminator_does_not_saturate_at_the_default_epochs(tmp_path):
    """At a step size of 3e-4 it called everything the victim's for good, and the imitator ran away."""
    config = tiny_config("apil", steps=45 * 4096, num_envs=64, ppo={"num_steps": 64})
    run(config, out=tmp_path / "r")
    last = metrics_of(tmp_path / "r")[-5:]
    assert min(m["apil/discriminator_accuracy_imitator"] for m in last) > 0.2
    assert max(m["apil/mse"] / m["apil/constant_mse"] for m in last) < 1.2
