"""Checks of a method in runs of a fraction of a second; the watched one serves several of them."""

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
from apil_core.policies.seats import victim_side
from apil_core.testing import company
from apil_core.testing.promises import METHOD_PROMISES, ContractError, promised
from apil_core.testing.states import differences
from apil_core.testing.subject import Subject, final_state, train
from apil_core.testing.watch import Watch, watching
from apil_core.training.build import build, build_hooks, method_setup
from apil_core.training.plugin_state import stored_and_read, unstorable
from apil_core.training.storage.run_dir import RunDir
from apil_core.training.trainer import Trainer


@dataclass
class Watched:
    """The run that is looked at from all sides.

    Attributes:
        out: its directory.
        config: of the run.
        trainer: as it ended.
        watch: all hook calls.
        state: its last checkpoint.
    """

    out: Path
    config: RunConfig
    trainer: Trainer
    watch: Watch
    state: dict[str, Any]


def built(subject: Subject, seed: int = 0) -> tuple[dict[str, Method], RunHookManager]:
    """The method and what it requires, by name, and the manager of their hooks; no run.

    Raises:
        ContractError: they cannot be built.
    """
    with promised(subject.who, METHOD_PROMISES["spec"]):
        config = complete(subject.config(seed=seed, num_envs=2), subject.registry)
        game = make_game(config.env, num_envs=1, threads=1, options=config.game, plugins=subject.registry)
        try:
            side = 1 - victim_side(config, subject.registry)
            torch.manual_seed(seed)
            setup = method_setup(config, game.layout, side, torch.device("cpu"))
            return build_hooks(config, subject.registry, setup)
        finally:
            game.close()


def check_state(subject: Subject, method: Method, when: str) -> None:
    """Plain, through a file, and into a fresh object.

    Args:
        subject: whose state it is.
        method: its object.
        when: for the message: how far it has got.

    Raises:
        ContractError: the state is not plain, does not load or does not come back.
    """
    promise = METHOD_PROMISES["state"]
    with promised(subject.who, promise):
        state = method.state_dict()
    if not isinstance(state, dict):
        raise subject.broken("state", f"state_dict() must return a dict, got {type(state).__name__}")
    if (culprit := unstorable(state, "state_dict()")) is not None:
        where, what = culprit
        raise subject.broken("state", f"{when}: {where} is a {what}, which a checkpoint cannot hold")
    with promised(subject.who, promise):
        read = stored_and_read(state)
        fresh = built(subject, seed=1)[0][subject.spec.name]
        fresh.load_state_dict(read)
        after = fresh.state_dict()
    if paths := differences(state, after):
        text = f"a fresh object that loaded the state of {when} has another: {_some(paths)}"
        raise subject.broken("state", text)


def watched_run(subject: Subject, out: Path) -> Watched:
    """Train under watch.

    Raises:
        ContractError: it fails, changes what it is handed, or draws from elsewhere.
    """
    watch = Watch()
    config = subject.config(evaluation={"episodes": 4})
    failure: ContractError | None = None
    try:
        trainer = train(subject, config, out, manager=watching(watch))
    except ContractError as error:
        failure = error
    for mistake in watch.mistakes:  # the first wrong thing, which may be why it failed
        raise subject.broken(mistake.promise, mistake.text, mistake.hook) from failure
    if failure is not None:
        raise failure
    return Watched(out, config, trainer, watch, final_state(out))


def check_same_seed(subject: Subject, run: Watched, out: Path) -> None:
    """The watched run once more, unwatched.

    Raises:
        ContractError: it trained something else.
    """
    train(subject, subject.config(), out, promise="seed")
    if paths := differences(run.state, final_state(out)):
        raise subject.broken("seed", f"two runs of one seed differ in {_some(paths)}")


def check_other_seed(subject: Subject) -> None:
    """The first weights of two seeds.

    Raises:
        ContractError: they are the same.
    """
    with promised(subject.who, METHOD_PROMISES["seed"]):
        weights = [_first_weights(subject, seed) for seed in (0, 1)]
    if not differences(*weights):
        text = "seeds 0 and 1 begin with the same policy: the method seeds torch's global generator"
        raise subject.broken("seed", text)


def _first_weights(subject: Subject, seed: int) -> Any:
    config = complete(subject.config(seed=seed, num_envs=2), subject.registry)
    attack = build(config, subject.registry)
    attack.game.close()
    return attack.actor.state_dict()


def check_resume(subject: Subject, run: Watched, out: Path) -> None:
    """From the second checkpoint to the end, in fresh objects.

    Raises:
        ContractError: the end differs.
    """
    middle = RunDir(run.out).checkpoint_path(2)
    train(subject, run.config, out, promise="resume", checkpoint_path=middle)
    if paths := differences(run.state, final_state(out)):
        lost = [path for path in paths if path.startswith(f"/methods/{subject.spec.name}/")]
        raise subject.broken("resume", f"after a resume these differ: {_some(lost or paths)}")
    whole, part = _metrics(run.out), _metrics(out)
    for row in part:
        if names := [key for key in row if row[key] != whole[int(row["iteration"])].get(key)]:
            raise subject.broken("resume", f"after a resume these metrics differ: {_some(names)}")


_CLOCKS = ("seconds", "_mb", "steps_per_second")


def _metrics(out: Path) -> Any:
    """Rows of the log without what the clock tells; a dict by iteration if asked for one, else a list."""
    lines = RunDir(out).metrics_path.read_text("utf-8").splitlines()
    rows = [json.loads(line) for line in lines]
    return _Rows({k: v for k, v in row.items() if not k.endswith(_CLOCKS)} for row in rows)


class _Rows(list[dict[str, Any]]):
    """Rows that can be asked for by iteration, from 1."""

    def __getitem__(self, iteration: Any) -> Any:
        return next(row for row in self if row["iteration"] == iteration)


def check_sizes(subject: Subject, folder: Path) -> None:
    """A single game, and more games than steps.

    Raises:
        ContractError: it does not train on them.
    """
    one = {"num_envs": 1, "steps": 16, "ppo": {"num_steps": 16, "epochs": 1, "minibatches": 2}}
    many = {"num_envs": 37, "steps": 37 * 3, "ppo": {"num_steps": 3, "epochs": 1, "minibatches": 2}}
    train(subject, subject.config(**one), folder / "one", promise="one game")
    train(subject, subject.config(**many), folder / "many", promise="many games")


def check_company(subject: Subject, out: Path) -> None:
    """Required by a method that answers everything, with an observer that blurs what both sides see.

    Raises:
        ContractError: it fails there, or loses what the others answer.
    """
    company.beside(subject.registry, subject.spec)
    changes = {
        "method": company.FOLLOWER,
        "observers": (company.OBSERVER,),
        "steps": 2 * 48,
        "evaluation": {"episodes": 2},
    }
    trainer = train(subject, subject.config(**changes), out, promise="company")
    (*_, last) = _metrics(out)
    follower = trainer.attack.methods[company.FOLLOWER]
    assert isinstance(follower, company.Follower)
    lost = {
        "extend_observation": company.GROUP not in follower.seen_groups,
        "shape_reward": f"reward/{company.TERM}" not in last,
        "finish_rollout": company.STREAM not in trainer.attack.learner.critics,
        "update_auxiliary": f"{company.FOLLOWER}/{company.METRIC}" not in last,
    }
    for hook in (hook for hook, gone in lost.items() if gone):
        raise subject.broken("company", f"{hook}: what another plugin answers is lost", hook)


def _some(paths: Sequence[str]) -> str:
    more = f" and {len(paths) - 3} more" if len(paths) > 3 else ""
    return f"{', '.join(path.lstrip('/') for path in paths[:3])}{more}"
