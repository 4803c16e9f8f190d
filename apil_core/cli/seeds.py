"""``apil run --seeds`` and its resumption: one run per seed, one table and one curve over all."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from apil_core.cli.bench_run import Placement, exit_code, perform_all, stored_benchmark
from apil_core.cli.finish import draw_curve, finish
from apil_core.cli.output import print_json
from apil_core.cli.progress import make_progress
from apil_core.common.errors import ConfigError
from apil_core.training.distributed.world import World

if TYPE_CHECKING:
    from apil_core.api.config import RunConfig
    from apil_core.studies.bench.cells import Benchmark
    from apil_core.studies.bench.folder import BenchDir


def train_seeds(
    config: RunConfig,
    seeds: list[int],
    out: Path | None,
    workers: int | None,
    *,
    show: bool,
    quiet: bool,
    as_json: bool,
) -> int:
    """Train with each seed, as many at a time as there are workers."""
    from apil_core.studies.seeds import seeds_benchmark, seeds_folder

    if World.here().size > 1:
        raise ConfigError("--seeds: torchrun's processes train one run together; start one per seed")
    benchmark = seeds_benchmark(config, seeds)
    where = Placement(workers, config.threads or None)
    return _perform(seeds_folder(config, out), benchmark, where, show=show, quiet=quiet, as_json=as_json)


def resume_seeds(
    directory: Path, steps: int | None, threads: int | None, *, show: bool, quiet: bool, as_json: bool
) -> int:
    """Go on with the seeds that are not finished, or extend all."""
    bench, benchmark = stored_benchmark(str(directory), None, steps)
    where = Placement(threads=threads)
    return _perform(bench, benchmark, where, show=show, quiet=quiet, as_json=as_json)


def _perform(
    bench: BenchDir, benchmark: Benchmark, where: Placement, *, show: bool, quiet: bool, as_json: bool
) -> int:
    result = perform_all(bench, benchmark, where, quiet=quiet)
    runs = [bench.cell(cell.name) for cell in benchmark.cells if not bench.failure(f"cells/{cell.name}")]
    from apil_core.runs.runner import RunResult

    ended = [RunResult.model_validate(found) for run in runs if (found := run.result())]
    with make_progress(quiet=quiet) as progress:
        documents = [finish(each, progress, show=show, as_json=True) for each in ended]
    if as_json:
        print_json(documents)
    elif len(ended) > 1:
        _summary(bench, [each.run_dir for each in ended])
    return exit_code(result, bench.path, f"apil resume {bench.path}")


def _summary(bench: BenchDir, runs: list[Path]) -> None:
    from apil_core.cli.runs import print_comparison
    from apil_core.studies.comparison import compare
    from apil_core.studies.loaded_run import plot_runs
    from apil_core.training.storage.run_dir import RunDir

    print_comparison(compare([RunDir(run) for run in runs]))
    curve = bench.path / "curve.png"
    draw_curve(curve, lambda: plot_runs(runs).save(curve))
