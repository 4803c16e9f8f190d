"""``apil eval``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from apil_core.cli.flags import Json, Plugins, Quiet
from apil_core.cli.output import print_json
from apil_core.cli.progress import make_progress
from apil_core.cli.scores import print_score

ActionMode = Literal["sample", "mode"]


def evaluate(
    adversary: Annotated[
        str, Parameter(name="ADVERSARY", help="Run directory, or a policy such as zoo:GAME/SIDE/v1.")
    ],
    /,
    *,
    env: Annotated[
        str | None, Parameter(alias="-e", help="Game; needed for a policy [default: the run's].")
    ] = None,
    victim: Annotated[
        str | None, Parameter(help="Policy to play against [default: the run's, else the game's default].")
    ] = None,
    episodes: Annotated[int, Parameter(help="Games to play; 1000 give ± 3 points at 50 %.")] = 1000,
    adversary_actions: Annotated[
        ActionMode | None, Parameter(help="Draw actions, or take the mode [default: as configured].")
    ] = None,
    victim_actions: Annotated[
        ActionMode | None, Parameter(help="Draw actions, or take the mode [default: as configured].")
    ] = None,
    checkpoint: Annotated[
        Path | None, Parameter(help="Checkpoint of the run to score [default: the newest].")
    ] = None,
    seed: Annotated[int, Parameter(help="Seed of the games and of all draws.")] = 0,
    num_envs: Annotated[
        int | None, Parameter(help="Games in parallel; a seed's games depend on it [default: up to 128].")
    ] = None,
    threads: Annotated[int, Parameter(help="Physics threads; 0: all CPUs. Never changes results.")] = 0,
    device: Annotated[str, Parameter(help="Where the networks live: cpu, cuda or cuda:N.")] = "cpu",
    plugin: Plugins | None = None,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Score an adversary: win, tie and loss rates with Wilson 95 % intervals, and how games ended.

    The same seed gives the same games at any number of threads.
    """
    from apil_core.evaluator import evaluate as score

    with make_progress(quiet=quiet) as progress:
        result = score(
            adversary,
            env=env,
            victim=victim,
            episodes=episodes,
            adversary_actions=adversary_actions,
            victim_actions=victim_actions,
            seed=seed,
            num_envs=num_envs,
            threads=threads,
            device=device,
            progress=progress,
            plugin_files=[str(path) for path in plugin or ()],
            checkpoint_path=checkpoint,
        )
    if as_json:
        print_json(result)
    else:
        print_score(result)
