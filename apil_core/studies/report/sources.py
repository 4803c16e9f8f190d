"""Sources of the report: runs with their scores, other adversaries', and other results of benchmarks."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

from apil_core.api.config import RunConfig
from apil_core.common.errors import ApilError, ConfigError, RunDirError
from apil_core.config.game import stored_physics
from apil_core.evaluation.crossplay.document import CrossPlay
from apil_core.evaluation.results import EvaluationResult, with_observers_played
from apil_core.studies.bench.cells import Benchmark, resolve_matrix
from apil_core.studies.bench.folder import BenchDir, CellDir, read_score
from apil_core.studies.bench.jobs import Job, make_jobs
from apil_core.studies.bench.matrix import BASELINE, PLAIN, Matrix
from apil_core.studies.curves.curves import final_score
from apil_core.studies.report.models import Unfinished
from apil_core.studies.report.published import published
from apil_core.studies.report.replayed import Replayed, read_stored, relabelled, replayed_in
from apil_core.training.storage.run_dir import RunDir

Read = TypeVar("Read")


@dataclass(frozen=True)
class Run:
    """A started training run.

    Attributes:
        name: of the cell in its benchmark, or of the directory.
        config: as stored.
        scores: by name; ``plain`` is the one the run ended with if no other has that name.
        axes: keys that its benchmark varies, without their values.
        failure: why it failed, or ``""``.
        steps: of training so far.
        summary: see :meth:`apil_core.training.storage.run_dir.RunDir.summary`.
    """

    dir: RunDir
    name: str
    config: RunConfig
    scores: Mapping[str, EvaluationResult]
    axes: tuple[str, ...]
    failure: str
    summary: Mapping[str, Any]

    @cached_property
    def physics(self) -> str | None:
        """Its training profile, ``"custom"``, or ``None`` for a game without profiles."""
        return stored_physics(self.config)

    @property
    def path(self) -> str:
        """Its directory."""
        return str(self.dir.path)

    @property
    def steps(self) -> int:
        """Training steps so far."""
        return int(self.summary["steps"])

    @property
    def status(self) -> str:
        """``failed``, or the status of the directory."""
        return "failed" if self.failure else str(self.summary["status"])


class StoredRun(RunDir):
    """A run directory with cached configuration: a report reads it often, and YAML is slow."""

    @cached_property
    def _config(self) -> RunConfig:
        return super().config()

    def config(self) -> RunConfig:
        """The stored configuration; not to be modified."""
        return self._config


class StoredBench(BenchDir):
    """A benchmark's directory with cached matrix and cells."""

    @cached_property
    def _matrix(self) -> Matrix:
        return super().matrix()

    def matrix(self) -> Matrix:
        """The stored, resolved matrix; not to be modified."""
        return self._matrix

    @cached_property
    def benchmark(self) -> Benchmark:
        """The resolved benchmark."""
        return resolve_matrix(self.matrix(), str(self.matrix_path))

    @cached_property
    def jobs(self) -> list[Job]:
        """Its jobs."""
        return make_jobs(self.benchmark)


@dataclass(frozen=True)
class Sources:
    """All sources, in the order given; ``crossplays`` are those that were named, not those of benchmarks."""

    runs: list[Run] = field(default_factory=list)
    missing: list[Unfinished] = field(default_factory=list)
    replayed: list[Replayed] = field(default_factory=list)
    crossplays: list[CrossPlay] = field(default_factory=list)
    benches: dict[str, tuple[StoredBench, Matrix]] = field(default_factory=dict)
    damaged: list[str] = field(default_factory=list)

    def read(self, reader: Callable[..., Read], *args: Any) -> Read | None:
        """Return the result of ``reader``; ``None``, and a note in ``damaged``, where a file is damaged."""
        try:
            return reader(*args)
        except ApilError as error:
            self.damaged.append(str(error))
            return None

    @property
    def games(self) -> list[str]:
        """Games of all matrices and runs."""
        named = [game for _, matrix in self.benches.values() for game in matrix.games]
        stored = [each.score.env for each in self.replayed if each.file]
        return list(dict.fromkeys([*named, *(run.config.env for run in self.runs), *stored]))

    @property
    def methods(self) -> list[str]:
        """Methods of all runs, started or not."""
        found = [run.config.method for run in self.runs] + [cell.method for cell in self.missing]
        return list(dict.fromkeys(found))


def read_sources(dirs: Sequence[Path], runs: Sequence[Path] = ()) -> Sources:
    """Read benchmark directories and single run directories.

    Args:
        dirs: of benchmarks, or of runs; files of single scores and cross-plays.
        runs: of runs.

    Raises:
        ApilError: one of them is none of these, or a file in it is damaged.
    """
    found, files = Sources(), []
    for path in dict.fromkeys(Path(path).resolve() for path in (*dirs, *runs)):
        shown = next(given for given in (*dirs, *runs) if Path(given).resolve() == path)
        if BenchDir(shown).matrix_path.is_file():
            _read_bench(StoredBench(shown), found)
        elif RunDir(shown).config_path.is_file():
            if path not in {Path(run.path).resolve() for run in found.runs}:
                run = found.read(_read_run, RunDir(shown), shown.name)
                found.runs.extend([run] if run is not None else [])
        elif path.is_file():
            files.append((shown, read_stored(shown)))
        else:
            raise RunDirError(f"{shown} is no benchmark (no matrix.yaml in it) and no run (no config.yaml)")
    own = {f"run:{Path(run.path).resolve()}" for run in found.runs}
    for shown, stored in files:
        found.replayed.extend(replayed_in(shown, stored, own))
        found.crossplays.extend([stored] if isinstance(stored, CrossPlay) else [])
    methods = {*published().columns, *found.methods} - {BASELINE}
    found.replayed[:] = relabelled(found.replayed, methods)
    if not found.runs and not found.missing and not files:
        raise ConfigError("\n".join([f"nothing to report in {', '.join(map(str, dirs))}", *found.damaged]))
    return found


def _read_bench(bench: StoredBench, found: Sources) -> None:
    matrix = bench.matrix()
    found.benches[str(bench.path)] = (bench, matrix)
    victims: dict[tuple[str, str], None] = {}
    for stored in bench.cells():
        cell, run = stored.cell, stored.run
        victims[cell.game, cell.victim] = None
        if not run.config_path.is_file():
            found.missing.append(_missing(stored, stored.status, stored.failure or "not started"))
            continue
        try:
            found.runs.append(_read_run(run, cell.name, tuple(cell.axes), stored.failure))
        except ApilError as error:  # one damaged cell must not hide the others
            found.missing.append(_missing(stored, "damaged", str(error)))
    for game, victim in victims:
        for label in (BASELINE, *matrix.adversaries.get(game, ())):
            scores = (found.read(bench.adversary, game, name, victim, label) for name in matrix.scores)
            found.replayed.extend(Replayed(label, score) for score in scores if score is not None)


def _missing(stored: CellDir, status: str, reason: str) -> Unfinished:
    """A cell without a started run, or whose run cannot be read."""
    return Unfinished(
        game=stored.cell.game,
        method=stored.cell.method,
        label=stored.cell.name,
        status=status,
        planned_steps=stored.cell.steps,
        reason=reason,
        path=str(stored.run.path),
    )


def _read_run(directory: RunDir, name: str, axes: tuple[str, ...] = (), failure: str = "") -> Run:
    run = StoredRun(directory.path)
    names = sorted(path.stem for path in (run.path / "scores").glob("*.json"))
    scores = {each: score for each in names if (score := read_score(run.path, each)) is not None}
    if PLAIN not in scores and (ended := final_score(run)) is not None:
        scores = {PLAIN: ended, **scores}
    config = run.config()
    scores = {each: with_observers_played(score, config) for each, score in scores.items()}
    ordered = dict(sorted(scores.items(), key=lambda item: item[0] != PLAIN))
    return Run(run, name, config, ordered, axes, failure, run.summary())
