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
from apil_core.plugins.registry import make_game
from apil_core.policies.loading import victim_side
from apil_core.testing import companions
from apil_core.testing.checks import METHOD_CHECKS, ContractError, reported_as
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


def built(tested: MethodUnderTest, seed: int = 0) -> tuple[dict[str, Method], RunHookManager]:
    """Build the method and what it requires, by name, and the manager of their hooks; no run."""
    with reported_as(tested.who, METHOD_CHECKS["spec"]):
        config = complete(tested.config(seed=seed, num_envs=2), tested.registry)
        game = make_game(config.env, num_envs=1, threads=1, options=config.game, plugins=tested.registry)
        try:
            side = 1 - victim_side(config, tested.registry)
            torch.manual_seed(seed)
            setup = method_setup(config, game.layout, side, torch.device("cpu"))
            return build_hooks(config, tested.registry, setup)
        finally:
            game.close()


def check_state(tested: MethodUnderTest, method: Method, when: str) -> None:
    """Check saved state: its types, through a file, and loaded into a fresh object.

    Args:
        tested: the method.
        method: its object.
        when: for the message: how far it has got.
    """
    check = METHOD_CHECKS["state"]
    with reported_as(tested.who, check):
        state = method.state_dict()
    if not isinstance(state, dict):
        raise tested.broken("state", f"state_dict() must return a dict, got {type(state).__name__}")
    if (culprit := unstorable(state, "state_dict()")) is not None:
        where, what = culprit
        raise tested.broken("state", f"{when}: {where} is a {what}, which a checkpoint cannot hold")
    with reported_as(tested.who, check):
        read = stored_and_read(state)
        fresh = built(tested, seed=1)[0][tested.spec.name]
        fresh.load_state_dict(read)
        after = fresh.state_dict()
    if paths := differences(state, after):
        text = f"a fresh object that loaded the state of {when} has another: {_some(paths)}"
        raise tested.broken("state", text)


def watched_run(tested: MethodUnderTest, out: Path) -> WatchedRun:
    """Train with all hook calls recorded."""
    spy = HookSpy()
    config = tested.config(evaluation={"episodes": 4})
    failure: ContractError | None = None
    try:
        trainer = train(tested, config, out, manager=spied_hooks(spy))
    except ContractError as error:
        failure = error
    for mistake in spy.mistakes:  # the first mistake, which may be the cause of the failure
        raise tested.broken(mistake.check, mistake.text, mistake.hook) from failure
    if failure is not None:
        raise failure
    return WatchedRun(out, config, trainer, spy, final_state(out))


def check_same_seed(tested: MethodUnderTest, run: WatchedRun, out: Path) -> None:
    """Check that the recorded run, repeated without recording, gives the same numbers."""
    train(tested, tested.config(), out, check="seed")
    if paths := differences(run.state, final_state(out)):
        raise tested.broken("seed", f"two runs of one seed differ in {_some(paths)}")


def check_other_seed(tested: MethodUnderTest) -> None:
    """Check that two seeds give different first weights."""
    with reported_as(tested.who, METHOD_CHECKS["seed"]):
        weights = [_first_weights(tested, seed) for seed in (0, 1)]
    if not differences(*weights):
        text = "seeds 0 and 1 begin with the same policy: the method seeds torch's global generator"
        raise tested.broken("seed", text)


def _first_weights(tested: MethodUnderTest, seed: int) -> Any:
    config = complete(tested.config(seed=seed, num_envs=2), tested.registry)
    attack = build(config, tested.registry)
    attack.game.close()
    return attack.actor.state_dict()


def check_resume(tested: MethodUnderTest, run: WatchedRun, out: Path) -> None:
    """Check that resuming from the second checkpoint, in fresh objects, gives the same numbers."""
    middle = RunDir(run.out).checkpoint_path(2)
    train(tested, run.config, out, check="resume", checkpoint_path=middle)
    if paths := differences(run.state, final_state(out)):
        lost = [path for path in paths if path.startswith(f"/methods/{tested.spec.name}/")]
        raise tested.broken("resume", f"after a resume these differ: {_some(lost or paths)}")
    whole, part = _metrics(run.out), _metrics(out)
    for iteration, row in part.items():
        if names := [key for key in row if row[key] != whole[iteration].get(key)]:
            raise tested.broken("resume", f"after a resume these metrics differ: {_some(names)}")


_CLOCKS = ("seconds", "_mb", "steps_per_second")


def _metrics(out: Path) -> dict[int, dict[str, Any]]:
    """Rows of the log by iteration, without timings."""
    rows = map(json.loads, RunDir(out).metrics_path.read_text("utf-8").splitlines())
    return {row["iteration"]: {k: v for k, v in row.items() if not k.endswith(_CLOCKS)} for row in rows}


def check_sizes(tested: MethodUnderTest, folder: Path) -> None:
    """Check a single game, and more games than steps."""
    one = {"num_envs": 1, "steps": 16, "ppo": {"num_steps": 16, "epochs": 1, "minibatches": 2}}
    many = {"num_envs": 37, "steps": 37 * 3, "ppo": {"num_steps": 3, "epochs": 1, "minibatches": 2}}
    train(tested, tested.config(**one), folder / "one", check="one game")
    train(tested, tested.config(**many), folder / "many", check="many games")


def check_companions(tested: MethodUnderTest, out: Path) -> None:
    """Check with a dependent method that implements every hook, and an observer of both sides."""
    companions.beside(tested.registry, tested.spec)
    changes = {
        "method": companions.FOLLOWER,
        "observers": (companions.OBSERVER,),
        "steps": 2 * 48,
        "evaluation": {"episodes": 2},
    }
    trainer = train(tested, tested.config(**changes), out, check="companions")
    (*_, last) = _metrics(out).values()
    follower = trainer.attack.methods[companions.FOLLOWER]
    assert isinstance(follower, companions.Follower)
    lost = {
        "extend_observation": companions.GROUP not in follower.seen_groups,
        "shape_reward": f"reward/{companions.TERM}" not in last,
        "relabel_reward": "reward/relabelled" not in last,
        "finish_rollout": companions.STREAM not in trainer.attack.learner.critics,
        "update_auxiliary": f"{companions.FOLLOWER}/{companions.METRIC}" not in last,
    }
    for hook in (hook for hook, gone in lost.items() if gone):
        raise tested.broken("companions", f"{hook}: what another plugin answers is lost", hook)


def _some(paths: Sequence[str]) -> str:
    more = f" and {len(paths) - 3} more" if len(paths) > 3 else ""
    return f"{', '.join(path.lstrip('/') for path in paths[:3])}{more}"
