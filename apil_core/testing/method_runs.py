"""Checks of a method in short runs, one of them with all hook calls recorded. Each raises ContractError."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from apil_core.api.config import RunConfig
from apil_core.api.method import Method
from apil_core.config.resolve import complete
from apil_core.plugins.hook_manager import RunHookManager
from apil_core.plugins.registry import layout_of
from apil_core.policies.loading import victim_side
from apil_core.testing import companions
from apil_core.testing.checks import ContractError, checking
from apil_core.testing.hook_spy import HookSpy, spied_hooks
from apil_core.testing.method_under_test import MethodUnderTest, final_state, train
from apil_core.testing.states import differences
from apil_core.training.build import build, build_hooks, method_setup
from apil_core.training.plugin_state import stored_and_read, unstorable
from apil_core.training.storage.run_dir import RunDir
from apil_core.training.trainer import Trainer


@dataclass
class WatchedRun:
    """The recorded run, used by several checks.

    Attributes:
        out: its directory.
        config: of the run.
        trainer: as it ended.
        spy: all hook calls.
        state: its last checkpoint.
    """

    out: Path
    config: RunConfig
    trainer: Trainer
    spy: HookSpy
    state: dict[str, Any]


@checking("spec")
def built(tested: MethodUnderTest, seed: int = 0) -> tuple[dict[str, Method], RunHookManager]:
    """Build the method and what it requires, by name, and the manager of their hooks; no run."""
    config = complete(tested.config(seed=seed, num_envs=2), tested.registry)
    layout = layout_of(config.env, config.game, tested.registry)
    side = 1 - victim_side(config, tested.registry)
    torch.manual_seed(seed)
    setup = method_setup(config, layout, side, torch.device("cpu"))
    return build_hooks(config, tested.registry, setup)


@checking("state")
def check_state(tested: MethodUnderTest, method: Method, when: str) -> None:
    """Check saved state: its types, through a file, and loaded into a fresh object.

    Args:
        tested: the method.
        method: its object.
        when: for the message: how far it has got.
    """
    state = method.state_dict()
    tested.need(isinstance(state, dict), f"state_dict() must return a dict, got {type(state).__name__}")
    where, what = unstorable(state, "state_dict()") or ("", "")
    tested.need(not where, f"{when}: {where} is a {what}, which a checkpoint cannot hold")
    read = stored_and_read(state)
    fresh = built(tested, seed=1)[0][tested.name]
    fresh.load_state_dict(read)
    paths = differences(state, fresh.state_dict())
    text = f"a fresh object that loaded the state of {when} has another: {_some(paths)}"
    tested.need(not paths, text)


@checking("run")
def watched_run(tested: MethodUnderTest, out: Path) -> WatchedRun:
    """Train with all hook calls recorded."""
    spy = HookSpy()
    config = tested.config(evaluation={"episodes": 4})
    try:
        with tested.check("run"):
            trainer = train(tested, config, out, manager=spied_hooks(spy))
    except ContractError as failure:
        _check_mistakes(tested, spy, failure)  # the first mistake may be the cause of the failure
        raise
    _check_mistakes(tested, spy)
    return WatchedRun(out, config, trainer, spy, final_state(out))


def _check_mistakes(tested: MethodUnderTest, spy: HookSpy, failure: ContractError | None = None) -> None:
    for mistake in spy.mistakes:
        with tested.check(mistake.check):
            raise tested.failed(mistake.text, mistake.hook) from failure


@checking("seed")
def check_same_seed(tested: MethodUnderTest, run: WatchedRun, out: Path) -> None:
    """Check that the recorded run, repeated without recording, gives the same numbers."""
    train(tested, tested.config(), out)
    paths = differences(run.state, final_state(out))
    tested.need(not paths, f"two runs of one seed differ in {_some(paths)}")


@checking("seed")
def check_other_seed(tested: MethodUnderTest) -> None:
    """Check that two seeds give different first weights."""
    weights = []
    for seed in (0, 1):
        attack = build(complete(tested.config(seed=seed, num_envs=2), tested.registry), tested.registry)
        attack.game.close()
        weights.append(attack.learner.actor.state_dict())
    text = "seeds 0 and 1 begin with the same policy: the method seeds torch's global generator"
    tested.need(differences(*weights), text)


@checking("resume")
def check_resume(tested: MethodUnderTest, run: WatchedRun, out: Path) -> None:
    """Check that resuming from the second checkpoint, in fresh objects, gives the same numbers."""
    train(tested, run.config, out, checkpoint_path=RunDir(run.out).checkpoint_path(2))
    paths = differences(run.state, final_state(out))
    lost = [path for path in paths if path.startswith(f"/methods/{tested.name}/")]
    tested.need(not paths, f"after a resume these differ: {_some(lost or paths)}")
    whole = _metrics(run.out)
    for iteration, row in _metrics(out).items():
        names = [key for key in row if row[key] != whole[iteration].get(key)]
        tested.need(not names, f"after a resume these metrics differ: {_some(names)}")


_CLOCKS = ("seconds", "_mb", "steps_per_second")


def _metrics(out: Path) -> dict[int, dict[str, Any]]:
    """Rows of the log by iteration, without timings."""
    rows = map(json.loads, RunDir(out).metrics_path.read_text("utf-8").splitlines())
    return {row["iteration"]: {k: v for k, v in row.items() if not k.endswith(_CLOCKS)} for row in rows}


def check_sizes(tested: MethodUnderTest, folder: Path) -> None:
    """Check a single game, and more games than steps."""
    one = {"num_envs": 1, "steps": 16, "ppo": {"num_steps": 16, "epochs": 1, "minibatches": 2}}
    many = {"num_envs": 37, "steps": 37 * 3, "ppo": {"num_steps": 3, "epochs": 1, "minibatches": 2}}
    for check, changes in (("one game", one), ("many games", many)):
        with tested.check(check):
            train(tested, tested.config(**changes), folder / check)


@checking("companions")
def check_companions(tested: MethodUnderTest, out: Path) -> None:
    """Check with a dependent method that implements every hook, and an observer of both sides."""
    companions.beside(tested.registry, tested.spec)
    changes = {
        "method": companions.FOLLOWER,
        "observers": (companions.OBSERVER,),
        "steps": 2 * 48,
        "evaluation": {"episodes": 2},
    }
    trainer = train(tested, tested.config(**changes), out)
    (*_, last) = _metrics(out).values()
    follower = trainer.attack.methods[companions.FOLLOWER]
    assert isinstance(follower, companions.Follower)
    kept = {
        "extend_observation": companions.GROUP in follower.seen_groups,
        "shape_reward": f"reward/{companions.TERM}" in last,
        "relabel_reward": "reward/relabelled" in last,
        "finish_rollout": companions.STREAM in trainer.attack.learner.critics,
        "update_auxiliary": f"{companions.FOLLOWER}/{companions.METRIC}" in last,
    }
    for hook, there in kept.items():
        tested.need(there, f"{hook}: what another plugin answers is lost", hook)


def _some(paths: Sequence[str]) -> str:
    more = f" and {len(paths) - 3} more" if len(paths) > 3 else ""
    return f"{', '.join(path.lstrip('/') for path in paths[:3])}{more}"
