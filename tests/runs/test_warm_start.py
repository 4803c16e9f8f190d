"""A training that starts from a policy: the adversary's own network is cloned from it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import torch
from helpers.small_runs import differences, final_state, metrics_of, small_config

from apil_core import ConfigError, RunConfig, VictimError, resume, run
from apil_core.api.types import OWN_GROUP
from apil_core.evaluation.progress import Progress
from apil_core.plugins.registry import default_plugins
from apil_core.runs.warm_start import load_teacher, warm_start
from apil_core.training.build import build
from apil_core.training.trainer import Trainer

ITERATION = 32 * 64


@pytest.fixture(scope="module")
def teacher(tmp_path_factory) -> Path:
    """A run that has learnt something."""
    out = tmp_path_factory.mktemp("teacher") / "run"
    run(starting(None, steps=20 * ITERATION), out=out)
    return out


def starting(name: Any, method: str = "adrl", **changes: Any) -> RunConfig:
    ppo = {"num_steps": 64, "epochs": 4, "minibatches": 4, "learning_rate": 1e-3}
    base: dict[str, Any] = {"steps": 12 * ITERATION, "init_steps": 10 * ITERATION, "num_envs": 32, "ppo": ppo}
    evaluation = {"episodes": 0, "periodic_episodes": 50}
    return small_config(method, init_from=name, evaluation=evaluation, **{**base, **changes})


class Notes(Progress):
    def __init__(self) -> None:
        self.lines: list[str] = []

    def note(self, text: str) -> None:
        self.lines.append(text)


def test_the_clone_acts_as_its_teacher(teacher):
    plugins = default_plugins()
    trainer = Trainer(build(starting(f"run:{teacher}", "e_apil"), plugins), plugins)
    policy = load_teacher(trainer, f"run:{teacher}")
    warm_start(trainer, policy)
    assert trainer.steps == 10 * ITERATION
    assert trainer.iteration == 0
    actor, pending = trainer.attack.learner.actor, trainer.attack.env.pending
    wanted = policy.act(pending.view, sample=False).distribution
    with torch.no_grad():
        found = actor(pending.observations)
    assert torch.allclose(found.std.expand_as(wanted.std), wanted.std, atol=1e-6)
    nats = wanted.kl(found).mean()
    assert nats < 0.1
    constant = (wanted.mean - wanted.mean.mean(0)).div(wanted.std).square().sum(-1).mean() / 2
    assert constant > 5 * nats  # there was something to learn
    # what the method adds has no say yet, and can get one
    own = actor.groups[OWN_GROUP]
    weight = actor.model.mlp[0].weight
    assert next(iter(actor.groups)) == OWN_GROUP
    assert len(actor.groups) > 1
    assert weight[:, own:].abs().max() == 0
    trainer.iterate()
    assert actor.model.mlp[0].weight[:, own:].abs().max() > 0
    trainer.attack.game.close()


def test_a_teacher_may_see_the_victims_action(tmp_path):
    plugins = default_plugins()
    oracle = {"apil": {"prediction": "oracle"}}
    run(starting(None, "apil", steps=ITERATION, options=oracle), out=tmp_path / "oracle")
    trainer = Trainer(build(starting(f"run:{tmp_path / 'oracle'}"), plugins), plugins)
    assert load_teacher(trainer, f"run:{tmp_path / 'oracle'}").info.action_size == 2
    trainer.attack.game.close()


def test_the_critic_is_fitted_and_the_policy_stays(teacher):
    plugins = default_plugins()
    trainer = Trainer(build(starting(f"run:{teacher}"), plugins), plugins)
    learner = trainer.attack.learner
    before = {name: value.clone() for name, value in learner.actor.state_dict().items()}
    losses = [trainer.iterate(actor_fixed=True)["ppo/value"] for _ in range(8)]
    assert differences(before, learner.actor.state_dict()) == []
    assert losses[-1] < 0.8 * losses[0]
    trainer.iterate()
    assert differences(before, learner.actor.state_dict()) != []
    trainer.attack.game.close()


def test_it_is_told_beside_its_teacher_and_goes_on_exactly(teacher, tmp_path):
    notes = Notes()
    short = {"init_steps": 2 * ITERATION}
    whole = run(
        starting(f"run:{teacher}", steps=4 * ITERATION, **short), out=tmp_path / "whole", progress=notes
    )
    (line,) = (line for line in notes.lines if line.startswith("warm start"))
    assert line.startswith(f"warm start: after {2 * ITERATION:,} steps the clone wins ")
    assert " of 50 games, run:" in line
    assert whole.steps == 4 * ITERATION
    rows = metrics_of(tmp_path / "whole")
    assert [(row["iteration"], row["steps"]) for row in rows] == [
        (1, 3 * ITERATION),
        (2, 4 * ITERATION),
    ]
    run(starting(f"run:{teacher}", steps=3 * ITERATION, **short), out=tmp_path / "parts")
    resume(tmp_path / "parts", steps=4 * ITERATION)
    ends = [final_state(tmp_path / name) for name in ("whole", "parts")]
    assert differences(*ends) == []


def test_what_cannot_be_cloned_is_refused_before_anything_is_made(teacher, tmp_path):
    for name, steps, error, reason in (
        (
            f"run:{teacher}",
            10 * ITERATION,
            ConfigError,
            r"takes 20,480 of the run's steps \(20,480; init_steps 20,480",
        ),
        ("embedded:you-shall-not-pass/blocker/v1", 12 * ITERATION, ConfigError, "observations and gives"),
        ("random", 12 * ITERATION, Exception, "is no run directory"),
        ("nobody:x", 12 * ITERATION, Exception, "unknown policy 'nobody:x'"),
        ("baseline:zero/7x2", 12 * ITERATION, VictimError, "has no action distribution"),
    ):
        with pytest.raises(error, match=reason):
            run(starting(name, steps=steps), out=tmp_path / "r")
        assert not (tmp_path / "r").exists()


def test_a_run_of_other_groups_says_how_to_clone_it(teacher, tmp_path):
    with pytest.raises(ConfigError, match=rf"to clone its adversary: --init-from run:{teacher}"):
        run(starting(teacher, "apil"), out=tmp_path / "r")


def test_however_few_steps_one_rollout_fits_the_critic(teacher, tmp_path):
    for init_steps, first in ((1, 3), (ITERATION, 3), (2 * ITERATION + 1, 4)):
        out = tmp_path / str(init_steps)
        run(starting(f"run:{teacher}", steps=4 * ITERATION, init_steps=init_steps), out=out)
        assert metrics_of(out)[0]["steps"] == first * ITERATION
    with pytest.raises(ConfigError, match=r"takes 4,096 of .* \(4,096; init_steps 1 in rollouts"):
        run(starting(f"run:{teacher}", steps=2 * ITERATION, init_steps=1), out=tmp_path / "r")
