"""Steps per second of training: this framework, Stable-Baselines3 and rsl_rl, in one process.

    python benchmarks/peers/compare.py --env kick-and-defend --physics faithful --json peers.json

All train PPO with the same settings on the same game against the same victim. They take turns, and the pure
physics is timed between them. See README.md beside this file.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import torch
from blocks import Block, as_json, measure, table
from ours import Ours
from pure_physics import PurePhysics
from rsl_rl_peer import RslRl
from task import Contestant, Task, victim_of

from apil_core.common.errors import ApilError
from apil_core.training.storage.environment import environment

SB3 = ("dummy:8", f"subproc:{os.cpu_count()}", "subproc:8", "batch:128")
"""Vectorisations tried by default."""


def main() -> None:
    arguments = _parser().parse_args()
    try:
        _compare(arguments)
    except ApilError as error:
        sys.exit(f"compare.py: {error}")
    except ModuleNotFoundError as error:
        if error.name != "stable_baselines3":
            raise
        folder = Path(__file__).parent
        sys.exit(f"compare.py: no {error.name} here; pip install -r {folder / 'requirements.txt'}")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("--env", default="kick-and-defend", help="game")
    add("--victim", help="default: the game's own")
    add("--physics", choices=("faithful", "fast"), help="short for --game '{\"physics\": ...}'")
    add("--game", type=json.loads, default={}, metavar="JSON", help="options of the game")
    add("--methods", nargs="*", default=["adrl", "e_apil"], help="ours")
    add(
        "--sb3",
        nargs="*",
        default=list(dict.fromkeys(SB3)),
        metavar="KIND:GAMES",
        help="dummy, subproc or batch",
    )
    add("--no-rsl-rl", action="store_true", help="leave its runner out")
    add("--seconds", type=float, default=600, help="for all rounds; at least two are played")
    add("--block", type=float, default=3, help="least seconds of a block; whole iterations count")
    add("--batch", type=int, default=16_384, help="steps of an iteration, for everybody")
    add("--num-envs", type=int, default=128, help="games at once, for ours and rsl_rl's")
    add("--threads", type=int, default=0, help="physics threads; 0: all CPUs")
    add("--peer-torch-threads", type=int, default=1, help="of SB3 and rsl_rl; 0: torch's own default")
    add("--json", type=Path, metavar="FILE", help="write all blocks there")
    return parser


def _task(arguments: argparse.Namespace) -> Task:
    options = dict(arguments.game)
    if arguments.physics:
        options["physics"] = arguments.physics
    return Task(
        env=arguments.env,
        options=options,
        victim=arguments.victim or victim_of(arguments.env),
        batch=arguments.batch,
        num_envs=arguments.num_envs,
        threads=arguments.threads,
    )


def _contestants(task: Task, arguments: argparse.Namespace) -> Iterator[Contestant]:
    torch_threads = arguments.peer_torch_threads or torch.get_num_threads()
    yield from (Ours(task, method) for method in arguments.methods)
    if arguments.sb3:
        from sb3_peer import StableBaselines

        yield from (StableBaselines(task, text, torch_threads) for text in arguments.sb3)
    if not arguments.no_rsl_rl:
        yield RslRl(task, torch_threads)


def _compare(arguments: argparse.Namespace) -> None:
    task = _task(arguments)
    with ExitStack() as stack:
        physics = _physics(task, stack)
        contestants = []
        for contestant in _contestants(task, arguments):
            stack.callback(contestant.close)
            contestants.append(contestant)
            _tell(f"warming up {contestant.name}")
            torch.set_num_threads(contestant.torch_threads)
            contestant.warm_up()
        blocks = measure(
            contestants, physics, seconds=arguments.seconds, least=arguments.block, tell=_tell_of
        )
    print(f"{task.env}, {task.options or 'default options'}, victim {task.victim}, batch {task.batch}")
    print(table(blocks))
    if arguments.json:
        arguments.json.write_text(json.dumps(_report(task, blocks), indent=2) + "\n")


def _physics(task: Task, stack: ExitStack) -> PurePhysics | None:
    try:
        physics = PurePhysics(task)
    except LookupError as error:
        _tell(f"{error}: no ratio to it")
        return None
    stack.callback(physics.close)
    physics.warm_up()
    return physics


def _report(task: Task, blocks: list[Block]) -> dict[str, Any]:
    return {"task": vars(task), "environment": environment(sys.argv), **as_json(blocks)}


def _tell_of(block: Block) -> None:
    beside = "" if block.physics is None else f", {block.rate / block.physics:.3f} of the physics beside it"
    _tell(f"round {block.turn}: {block.contestant:18} {block.rate:8.0f} steps/s{beside}")


def _tell(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
