"""``apil resume``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from apil_core.cli.finish import exit_code, finish
from apil_core.cli.flags import Json, Quiet, Show
from apil_core.cli.output import print_json
from apil_core.cli.progress import make_progress
from apil_core.cli.seeds import resume_seeds
from apil_core.common.errors import ConfigError, RunDirError
from apil_core.common.extras import need
from apil_core.config.kind import is_retraining
from apil_core.studies.bench.folder import SEEDS_FILE
from apil_core.training.distributed.world import World


def resume(
    directory: Annotated[
        Path, Parameter(name="DIR", help="Directory of a run, of several seeds or of a retraining.")
    ],
    /,
    *,
    steps: Annotated[int | None, Parameter(help="New total budget; also extends a finished run.")] = None,
    checkpoint: Annotated[
        Path | None, Parameter(help="Checkpoint to continue from, or best [default: the newest].")
    ] = None,
    threads: Annotated[
        int | None,
        Parameter(help="Threads of physics, and of the update (two at most); never changes results."),
    ] = None,
    show: Show = False,
    quiet: Quiet = False,
    as_json: Json = False,
) -> int:
    """Continue a run or a retraining exactly where its last checkpoint left it, or extend a finished one."""
    if (directory / SEEDS_FILE).is_file():
        if checkpoint is not None:
            raise ConfigError(f"--checkpoint: {directory} holds several seeds; resume one of them")
        return resume_seeds(directory, steps, threads, show=show, quiet=quiet, as_json=as_json)
    if not (directory / "config.yaml").is_file():
        raise RunDirError(f"{directory} is no run directory (no config.yaml in it)")

    if is_retraining(directory):
        from apil_core.cli.retrain import resume as resume_retraining

        return resume_retraining(
            directory, steps=steps, checkpoint=checkpoint, threads=threads, quiet=quiet, as_json=as_json
        )

    if show:
        need("matplotlib", "av")
    from apil_core.runs import runner

    here = World.here()
    with make_progress(quiet=quiet or not here.is_main) as progress:
        result = runner.resume(
            directory,
            steps=steps,
            checkpoint_path=checkpoint,
            threads=threads,
            progress=progress,
            command=["apil", *sys.argv[1:]],
        )
        document = finish(result, progress, show=show, as_json=as_json) if here.is_main else {}
    if as_json and here.is_main:
        print_json(document)
    return exit_code(result, here)
