"""The Lemma's diagnostics of runs: hand arithmetic on logs, and exact KL between a real run's checkpoints."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
import torch
from helpers.small_runs import small_config
from studies.paper_runs import row, write_run

import apil_core
from apil_core import ConfigError, RunDirError
from apil_core.api.policy import Policy, PolicyInfo
from apil_core.api.types import Decision, DiagonalGaussian, View
from apil_core.studies.theory.compared_games import ComparedGames, ComparedPolicy
from apil_core.studies.theory.diagnostics import BOUND, IMITATOR_KL, KL, KL_MAX, Diagnostics, diagnose
from apil_core.studies.theory.policy_change import PolicyChange, _compare, policy_changes
from apil_core.training.storage.run_dir import RunDir

NAN = float("nan")
BIT = math.log(2)


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> RunDir:
    """Three iterations of E-APIL, each with a checkpoint."""
    config = small_config(steps=3 * 512, checkpoint={"every_iterations": 1, "keep": 3})
    path = tmp_path_factory.mktemp("theory") / "run"
    apil_core.run(config, out=path)
    return RunDir(path)


@pytest.fixture(scope="module")
def changes(trained: RunDir) -> list[PolicyChange]:
    return policy_changes(trained, games=20, seed=3)


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
    assert (found.steps, found.informative_share, found.changes) == (3000, 0.5, [])
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
    with pytest.raises(RunDirError, match="keeps 0 checkpoints"):
        diagnose(silent, games=2)
    for wrong in ({"games": 1}, {"games": -1}, {"value_bound": -1.0}, {"value_bound": NAN}):
        with pytest.raises(ConfigError, match=next(iter(wrong))):
            diagnose(silent, **wrong)  # type: ignore[arg-type]


# --- played


def test_changes_between_kept_checkpoints(changes: list[PolicyChange]) -> None:
    assert [(change.steps_before, change.steps_after) for change in changes] == [(512, 1024), (1024, 1536)]
    for change in changes:
        assert 0 < change.kl_mean < change.kl_max < 1
        assert change.games == 20
        assert change.states > 20 * 3
        # a game of at most 50 steps is far from 1 / (1 − γ) = 100
        assert 0 < change.bound_visits < change.bound_max
        assert change.largest_value == pytest.approx(10.0)  # a game's end is worth ±1000 · 0.01
        assert change.value_before.low <= change.value_before.value <= change.value_before.high
        difference = change.value_after.value - change.value_before.value
        assert change.change.value == pytest.approx(difference)
        assert abs(difference) < change.bound_visits
    assert changes[0].value_after == changes[1].value_before  # the same games


def test_the_logs_kl_is_of_one_update(trained: RunDir, changes: list[PolicyChange]) -> None:
    """Exact KL of the scored policies also has the normaliser and the imitator in it, so not less by much."""
    lines = diagnose(trained).lines
    logged = dict(zip(lines[KL].steps, lines[KL].value, strict=True))
    for change in changes:
        assert 0.3 * logged[change.steps_after] < change.kl_mean < 30 * logged[change.steps_after]


class Normal(Policy):
    """The same normal distribution in every state."""

    def __init__(self, mean: float, std: float):
        self.info = PolicyInfo("normal", "", 1, 1)
        self.mean, self.std = mean, std

    def act(self, view: View, **_: object) -> Decision:
        mean = torch.full((len(view.own), 1), self.mean)
        return Decision(mean, DiagonalGaussian(mean, torch.full((1,), self.std)))


def test_kl_is_from_before_to_after_in_bits() -> None:
    """KL(N(0, 1) ‖ N(1, 2²)) = ln 2 + (1 + 1) / 8 − ½ nats; the other way round it is 1.306."""
    compared = ComparedPolicy(Normal(0.0, 1.0), Normal(1.0, 2.0))
    compared.act(View(torch.zeros(3, 1), torch.zeros(3, 1), torch.ones(3, dtype=torch.bool)), sample=True)
    assert compared.divergence == pytest.approx(np.full(3, (math.log(2) - 0.25) / BIT), rel=1e-6)


def test_values_of_games_by_hand() -> None:
    """A reward of 8 in the third step: 2, 4, 8 from each step on, Γ = γ · 2; the other game ends at once."""
    playing = np.array([[True, True], [True, False], [True, False]])
    rewards = np.array([[0.0, -6.0], [0.0, 0.0], [8.0, 0.0]])
    games = ComparedGames(0, 0.5, playing, rewards, np.full((3, 2), 4.0))
    np.testing.assert_allclose(games.following, [[2, -6], [4, 0], [8, 0]])
    np.testing.assert_allclose(games.values, [1, -3])
    change = _compare(games, games)
    assert (change.states, change.kl_mean, change.largest_value) == (4, 4.0, 8.0)
    # Σ γ^t √4 is 2 · 1.75 in the first game and 2 in the second: 2.75 on average
    assert change.bound_visits == pytest.approx(0.5 * 8 * 1.1774100 * 2.75)
    assert change.bound_max == pytest.approx(0.5 * 8 * 1.1774100 / 0.5 * 2)


def test_a_policy_is_no_distance_from_itself(trained: RunDir, tmp_path: Path) -> None:
    """The same weights twice: nothing changes, whatever is drawn."""
    copy = tmp_path / "copy"
    (copy / "checkpoints").mkdir(parents=True)
    (copy / "config.yaml").write_bytes(trained.config_path.read_bytes())
    newest = trained.newest_checkpoint().read_bytes()
    for number in (1, 2):
        (copy / f"checkpoints/iteration-{number:08d}.pt").write_bytes(newest)
    (change,) = policy_changes(RunDir(copy), games=2)
    assert (change.kl_mean, change.kl_max, change.bound_max, change.change.value) == (0, 0, 0, 0)


def test_played_games_say_how_large_a_value_is(trained: RunDir) -> None:
    found = diagnose(trained, games=2, seed=1)
    assert found.value_bound_from == "play"
    assert found.value_bound == max(change.largest_value for change in found.changes)


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
    rows = [json.loads(line) for line in trained.metrics_path.read_text().splitlines()]
    for name in ("ppo/kl", "return/victim", "apil/imitator_kl"):
        assert any(np.isfinite(r.get(name) or np.nan) for r in rows), name
