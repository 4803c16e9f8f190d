"""``apil bench run``: run a matrix of trainings, from resolving it to the last score."""

from __future__ import annotations

import os
import time
from collections.abc import Collection
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Group, Parameter

from apil_core.cli.flags import Json, Quiet
from apil_core.cli.guard import INTERRUPTED, complain
from apil_core.cli.progress import make_progress
from apil_core.common.errors import ApilError, ConfigError
from apil_core.common.extras import need
from apil_core.studies.bench.matrix import NAMES_WITHOUT_BUDGET, matrix_names

if TYPE_CHECKING:
    from apil_core.studies.bench.cells import Benchmark
    from apil_core.studies.bench.executor import Executor
    from apil_core.studies.bench.folder import BenchDir
    from apil_core.studies.bench.schedule import BenchResult

_WHERE = Group("Where it runs", sort_key=1)
_ROOT = Path("runs") / "bench"


@Parameter(name="*")
@dataclass
class Placement:
    """Flags for the executor and the number of parallel jobs."""

    workers: Annotated[
        int | None, Parameter(group=_WHERE, help="Jobs at the same time [default: one per CPU].")
    ] = None
    threads: Annotated[
        int | None,
        Parameter(
            group=_WHERE, help="Physics threads of each; never changes results [default: CPUs / workers]."
        ),
    ] = None
    executor: Annotated[
        Literal["local", "ray"],
        Parameter(group=_WHERE, help="local: processes on this machine; ray: a cluster."),
    ] = "local"
    address: Annotated[
        str | None,
        Parameter(
            group=_WHERE, help="The Ray cluster, e.g. auto or ray-head:6379 [default: a new one here]."
        ),
    ] = None

    def share(self) -> tuple[int, int]:
        """Number of parallel jobs, and threads per job; by default their product is the number of CPUs.

        Only Ray knows a cluster's number of CPUs: each job gets one there, and 0 workers means as many
        as fit.

        Raises:
            ConfigError: a number below 1.
        """
        for name, value in (("--workers", self.workers), ("--threads", self.threads)):
            if value is not None and value < 1:
                raise ConfigError(f"{name} must be at least 1, got {value}")
        if self.executor == "ray":
            return self.workers or 0, self.threads or 1
        cpus = os.cpu_count() or 1
        count = self.workers or cpus
        return count, self.threads or max(cpus // count, 1)

    def start(self, root: Path) -> Executor:
        """Make the executor for the jobs of the benchmark in ``root``."""
        workers, threads = self.share()
        if self.executor == "ray":
            from apil_core.studies.bench.ray_executor import RayExecutor

            return RayExecutor(root, workers or None, threads, self.address)
        if self.address is not None:
            raise ConfigError("--address is a Ray cluster's: add --executor ray")
        from apil_core.studies.bench.executor import LocalProcesses

        return LocalProcesses(root, workers, threads)


def run(
    matrix: Annotated[
        str,
        Parameter(
            name="MATRIX",
            help=f"YAML file, a shipped matrix ({', '.join(matrix_names())}), or a directory to go on in.",
        ),
    ],
    /,
    *,
    out: Annotated[
        Path | None,
        Parameter(help=f"The benchmark's directory [default: {_ROOT}/NAME]; continued if it exists."),
    ] = None,
    steps: Annotated[
        int | None,
        Parameter(
            help="Budget of all cells [default: the matrix's]; a higher one takes finished cells on.",
        ),
    ] = None,
    dry_run: Annotated[
        bool,
        Parameter(
            show_default=False, help="Only print the cells, and how long they will take as measured here."
        ),
    ] = False,
    where: Placement | None = None,
    quiet: Quiet = False,
    as_json: Json = False,
) -> int:
    """Run every combination of methods, games, seeds, victims, budgets and further axes of a matrix.

    Everything is checked before anything starts. The same command resumes an interrupted benchmark: finished
    cells are kept, unfinished ones resume bit for bit. A cell that fails is reported and does not stop the
    others. Cells start seed by seed, in each method by method, in each game by game, as in the matrix.
    """
    from apil_core.cli.bench_table import print_plan, print_result
    from apil_core.studies.bench.estimate import estimate
    from apil_core.studies.bench.jobs import JobStatus, make_jobs

    where = where or Placement()
    bench, benchmark = stored_benchmark(matrix, out, steps)
    workers, threads = where.share()
    jobs, status = make_jobs(benchmark), JobStatus(bench, benchmark)
    if dry_run:
        if where.executor == "ray":
            need("ray")
            workers = workers or 1  # a cluster's capacity is known once it is joined
        with make_progress(quiet=quiet) as progress:
            cost = estimate(benchmark, status, threads=threads, jobs=jobs, note=progress.note)
        print_plan(benchmark, jobs, status, cost, workers, as_json=as_json)
        return 0
    begin = time.perf_counter()
    result = perform_all(bench, benchmark, where, quiet=quiet)
    print_result(result, status, time.perf_counter() - begin, as_json=as_json)
    return exit_code(result, bench.path)


def perform_all(bench: BenchDir, benchmark: Benchmark, where: Placement, *, quiet: bool) -> BenchResult:
    """Do all jobs of a benchmark that are not done yet, showing their progress."""
    from apil_core.cli.bench_table import make_watch
    from apil_core.studies.bench.schedule import run_benchmark

    return run_benchmark(bench, benchmark, where.start, partial(make_watch, quiet=quiet))


def stored_benchmark(matrix: str, out: Path | None, steps: int | None) -> tuple[BenchDir, Benchmark]:
    """Return the directory and the resolved benchmark, with all players checked."""
    from apil_core.studies.bench.cells import resolve_matrix
    from apil_core.studies.bench.folder import BenchDir
    from apil_core.studies.bench.players import with_full_names

    source, directory = _source(matrix, out)
    if steps is not None:
        if len(source.steps) > 1:
            raise ConfigError(f"--steps stands for one budget, {matrix} has several: change them there")
        source = source.model_copy(update={"steps": (steps,)})
    bench, benchmark = BenchDir(directory), resolve_matrix(source, matrix)
    named = [game for game, victims in source.victims.items() if "auto" not in victims]
    benchmark = _same_as_stored(bench, with_full_names(benchmark, matrix), named)
    if steps is not None and benchmark.matrix.version < NAMES_WITHOUT_BUDGET:
        raise ConfigError(
            f"{directory} was begun by an older version, with the budget in its cells' names, which cannot "
            "be raised: leave --steps out to go on, or choose another --out"
        )
    return bench, benchmark


def _source(name: str, out: Path | None) -> tuple[Any, Path]:
    """Return the matrix and the directory of its benchmark."""
    from apil_core.studies.bench.folder import BenchDir
    from apil_core.studies.bench.matrix import load_matrix

    if Path(name).is_dir():
        if out is not None and out.resolve() != Path(name).resolve():
            raise ConfigError(f"{name} is a benchmark already; leave --out out to go on with it")
        return BenchDir(name).matrix(), Path(name)
    matrix = load_matrix(name)
    return matrix, out or _ROOT / (Path(name).stem if name.endswith((".yaml", ".yml")) else Path(name).name)


def _same_as_stored(bench: BenchDir, benchmark: Benchmark, named: Collection[str] = ()) -> Benchmark:
    """Return the benchmark with the victims pinned in its directory.

    Args:
        bench: its directory.
        benchmark: the requested one.
        named: games with victims in the matrix.

    Raises:
        ConfigError: a cell or a retraining that was begun there has other settings now.
        RunDirError: the directory holds something else.
    """
    from apil_core.common.errors import RunDirError
    from apil_core.studies.bench.cells import resolve_matrix
    from apil_core.studies.bench.players import check_same_adversaries
    from apil_core.studies.bench.still_valid import check_same_retraining
    from apil_core.studies.bench.work import check_same

    if not bench.matrix_path.is_file():
        if bench.path.exists() and (not bench.path.is_dir() or _occupied(bench.path)):
            raise RunDirError(f"{bench.path} exists and is no benchmark; choose another --out")
        return benchmark
    matrix = bench.matrix()
    check_same_adversaries(bench, benchmark)
    stored = matrix.victims
    for game in named:
        before, now = stored.get(game), benchmark.matrix.victims[game]
        if before not in (None, now):
            raise ConfigError(
                f"{bench.path} attacks {', '.join(before)} in {game}, the matrix says {', '.join(now)}; "
                "give the changed matrix another --out"
            )
    budgets = matrix.steps, benchmark.matrix.steps
    if budgets[0][0] != budgets[1][0] and max(map(len, budgets)) > 1:
        there, here = (", ".join(map(str, steps)) for steps in budgets)
        raise ConfigError(
            f"{bench.path} has the budgets {there}, the matrix {here}; the first of several must stay, "
            "since its cells are named without it: put new ones behind it"
        )
    pinned = {game: stored.get(game, names) for game, names in benchmark.matrix.victims.items()}
    # the version determines the names of cells
    asked = benchmark.matrix.model_copy(update={"victims": pinned, "version": matrix.version}, deep=True)
    benchmark = resolve_matrix(asked, str(bench.matrix_path))
    for cell in benchmark.cells:
        run, begun = bench.cell(cell.name), None
        with suppress(ApilError):  # if it cannot be read, its job reports the error
            begun = run.config()
        if begun is not None:
            check_same(begun, cell)
        check_same_retraining(bench.retrained_dir(cell.name), benchmark.matrix.retraining)
    return benchmark


def _occupied(path: Path) -> bool:
    """Return whether the directory holds more than the lock of a benchmark killed before its first write."""
    return any(entry.name != ".lock" for entry in path.iterdir())


def exit_code(result: BenchResult, directory: Path, resume: str = "") -> int:
    """Return 0, or after Ctrl-C or a failure another code; prints how to continue."""
    resume = resume or f"apil bench run {directory}"
    if result.interrupted:
        return complain(f"interrupted; go on with: {resume}", INTERRUPTED)
    failed = result.having("failed")
    if failed:
        return complain(
            f"{len(failed)} of {len(result.states)} jobs failed; try them again: {resume}",
            1,
        )
    return 0
