"""Several seeds of one run: a benchmark whose cells are DIR/s0, DIR/s1, …"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from apil_core.api.config import RunConfig
from apil_core.common.errors import ApilError, ConfigError
from apil_core.common.files import refuse_taken, unused
from apil_core.common.machine import threads_each
from apil_core.plugins.defined import ORIGIN
from apil_core.plugins.registry import plugins_with
from apil_core.runs.runner import run
from apil_core.studies.bench.cells import Benchmark, resolve_matrix
from apil_core.studies.bench.executor import LocalProcesses
from apil_core.studies.bench.folder import BenchDir
from apil_core.studies.bench.matrix import Matrix
from apil_core.studies.bench.schedule import run_benchmark
from apil_core.studies.loaded_run import LoadedRun
from apil_core.training.storage.run_dir import DEFAULT_ROOT

_AXES = {"version", "method", "env", "victim", "seed", "steps", "victim_sha256", "trust"}


def seeds_benchmark(config: RunConfig, seeds: Sequence[int]) -> Benchmark:
    """The benchmark of one configuration under several seeds.

    Raises:
        ApilError: a name or value in it is wrong, or a seed is named twice.
    """
    matrix = Matrix(
        title=f"{config.method} in {config.env}, {len(seeds)} seeds",
        methods=(config.method,),
        games=(config.env,),
        seeds=tuple(seeds),
        steps=(config.steps,),
        victims={config.env: (config.victim,)},
        config=config.model_dump(exclude=_AXES),
        baseline=False,
    )
    return resolve_matrix(matrix, "seeds")


def seeds_folder(config: RunConfig, out: Path | str | None) -> BenchDir:
    """The directory of such a benchmark; default: ``runs/ENV/METHOD/seeds``, or that with ``-2`` etc."""
    return BenchDir(out or unused(DEFAULT_ROOT / config.env / config.method / "seeds"), flat=True)


def run_seeds(
    config: RunConfig,
    seeds: Sequence[int],
    *,
    out: Path | str | None = None,
    workers: int = 1,
    **session: Any,
) -> list[LoadedRun]:
    """Train with several seeds; interrupted, ``apil resume DIR`` goes on with those that are left.

    Args:
        config: of all; its own seed does not count.
        seeds: each becomes the run ``out/s<seed>``.
        out: directory; default ``runs/<env>/<method>/seeds``.
        workers: trainings at a time, each in a process of its own. 1: one after the other in this process,
            where classes of this session are known.
        session: ``methods``, ``callbacks`` and ``progress`` of :func:`apil_core.run`, with one worker only.

    Raises:
        ApilError: as :func:`apil_core.run`; or a training failed.
    """
    refuse_taken(out)
    benchmark, bench = seeds_benchmark(config, seeds), seeds_folder(config, out)
    if workers > 1:
        _check_known_elsewhere(config, session)
        start = partial(LocalProcesses, workers=workers, threads=threads_each(workers))
        if failed := run_benchmark(bench, benchmark, start).having("failed"):
            raise ApilError("; ".join(f"{name}: {bench.failure(name)}" for name in failed))
    else:
        bench.write_matrix(benchmark.matrix)
        for cell in benchmark.cells:
            if run(cell.config, out=bench.cell(cell.name).path, **session).status == "interrupted":
                break
    paths = [bench.cell(cell.name).path for cell in benchmark.cells]
    return [LoadedRun(path) for path in paths if (path / "config.yaml").is_file()]


def _check_known_elsewhere(config: RunConfig, session: dict[str, Any]) -> None:
    """Check that other processes know all that the runs name."""
    here = {record.name for record in plugins_with(config.plugins).records if record.origin == ORIGIN}
    names = sorted({config.method, *config.observers} & here) + sorted(session)
    if names:
        raise ConfigError(f"{names[0]} lives in this Python process only: workers=1, or make it a plugin")
