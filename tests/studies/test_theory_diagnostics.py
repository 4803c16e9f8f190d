"""The Lemma's diagnostics of runs: hand arithmetic on logs, and the KL that a real run logs."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import torch
from helpers.small_runs import metrics_of, small_config, three_iterations

from apil_core import ConfigError, RunDirError
from apil_core.api.types import DiagonalGaussian
from apil_core.studies.theory.diagnostics import BOUND, IMITATOR_KL, KL, KL_MAX, Diagnostics, diagnose
from apil_core.training.storage.run_dir import RunDir
from studies.paper_runs import row, write_run

NAN = float("nan")
BIT = math.log(2)


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> RunDir:
    return three_iterations(tmp_path_factory.mktemp("theory") / "run")


# --- the log alone


def test_bits_and_bound_by_hand(tmp_path: Path) -> None:
    """0.04 bits, H = 10, γ = 0.99: 0.99 · 10 · 1.17741 / 0.01 · 0.2 = 233.1."""
    rows = [
        row(1000, 30, 0, **{"ppo/kl": 0.04 * BIT, "return/victim": -10.0, "apil/imitator_kl": 0.5 * BIT}),
        row(2000, 30, 0, **{"ppo/kl": -1e-9, "return/victim": 3.0, "ppo/kl_max": 0.3 * BIT}),
        row(3000, 30, 0, **{"ppo/kl": NAN, "return/victim": NAN}),
    ]
    found = diagnose(write_run(tmp_path / "r", rows))
    assert found.lines[KL].steps == found.lines[BOUND].steps == [1000, 2000]
    assert found.lines[KL].value == pytest.approx([0.04, 0.0])
    assert found.lines[BOUND].value == pytest.approx([233.127, 0.0], abs=1e-3)
    assert (found.lines[IMITATOR_KL].value, found.lines[IMITATOR_KL].steps) == (pytest.approx([0.5]), [1000])
    assert (found.lines[KL_MAX].value, found.lines[KL_MAX].steps) == (pytest.approx([0.3]), [2000])
    assert (found.value_bound, found.value_bound_from, found.trivial_bound) == (10.0, "returns", 20.0)
    assert (found.steps, found.informative_share) == (3000, 0.5)
    assert len(found.notes) == 4
    assert Diagnostics.model_validate_json(found.model_dump_json()) == found


def test_a_given_value_bound_and_merged_rows(tmp_path: Path) -> None:
    run = write_run(tmp_path / "r", [row(1000, 30, 0, **{"ppo/kl": 0.04 * BIT, "row_iterations": 7.0})])
    found = diagnose(run, value_bound=1.0)
    assert found.lines[BOUND].value == pytest.approx([23.3127], abs=1e-4)
    assert found.value_bound_from == "given"
    assert any("several updates" in note for note in found.notes)
    assert set(found.lines) == {KL, BOUND}


def test_logs_that_say_nothing(tmp_path: Path) -> None:
    with pytest.raises(RunDirError, match="no run directory"):
        diagnose(RunDir(tmp_path / "nowhere"))
    with pytest.raises(RunDirError, match="no ppo/kl"):
        diagnose(write_run(tmp_path / "a", [row(1000, 30, 0)]))
    silent = write_run(tmp_path / "b", [row(1000, 0, 0, **{"ppo/kl": 0.1})])
    with pytest.raises(RunDirError, match="no game has ended"):
        diagnose(silent)
    for wrong in (-1.0, NAN):
        with pytest.raises(ConfigError, match="value_bound"):
            diagnose(silent, value_bound=wrong)


def test_kl_of_the_log_is_the_mean_over_the_rollout(tmp_path: Path) -> None:
    """``ppo/kl`` is KL(old ‖ new) over all states of the rollout after the last epoch, in nats."""
    from apil_core.plugins.discovery import discover
    from apil_core.training.build import build
    from apil_core.training.trainer import Trainer

    plugins = discover()
    trainer = Trainer(build(small_config("adrl"), plugins), plugins)
    try:
        before = trainer.attack.learner.actor.std.detach().clone()
        metrics = trainer.iterate()
        storage, actor = trainer.attack.learner.storage, trainer.attack.learner.actor
        old = DiagonalGaussian(storage.means.flatten(0, 1), before)
        with torch.no_grad():
            per_state = old.kl(actor(storage.observations.flatten(0, 1)))
        assert len(per_state) == 512
        assert metrics["ppo/kl"] == pytest.approx(float(per_state.mean()), rel=1e-4)
        by_hand = [torch.distributions.kl_divergence(*pair).sum() for pair in _normals(old, actor, storage)]
        assert float(per_state[0]) == pytest.approx(float(by_hand[0]), rel=1e-3, abs=1e-7)
    finally:
        trainer.attack.game.close()


def _normals(old, actor, storage):  # type: ignore[no-untyped-def]
    with torch.no_grad():
        new = actor(storage.observations.flatten(0, 1)[:1])
    yield torch.distributions.Normal(old.mean[0], old.std), torch.distributions.Normal(new.mean[0], new.std)


def test_metrics_are_where_the_diagnostics_look(trained: RunDir) -> None:
    """Names in the log that another part of the framework writes."""
    rows = metrics_of(trained.path)
    for name in ("ppo/kl", "return/victim", "apil/imitator_kl"):
        assert any(np.isfinite(r.get(name) or np.nan) for r in rows), name
