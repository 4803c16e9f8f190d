"""The jobs of a benchmark, their dependencies, and whether they are done."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from apil_core.common.errors import ApilError
from apil_core.studies.bench.cells import Benchmark, Cell
from apil_core.studies.bench.folder import BenchDir, read_score
from apil_core.studies.bench.matrix import BASELINE, ScoreConfig
from apil_core.training.storage.run_dir import RunDir

if TYPE_CHECKING:
    from apil_core.evaluation.crossplay.document import CrossPlay

CELL, BASELINES, ADVERSARIES, RETRAINING, CROSSPLAY, ACTIVATIONS, SNAPSHOTS = (
    "cells",
    BASELINE,
    "adversaries",
    "retrained",
    "crossplay",
    "activations",
    "snapshots",
)
"""Kinds of jobs, which are also the folders their results are in."""


@dataclass(frozen=True)
class Job:
    """One unit of work, run by one process.

    Attributes:
        kind: one of the kinds above.
        subject: the cell's name, the game, game and victim, or game, adversary's label and victim.
        needs: names of jobs that must be done before.
        after: names of jobs that must have ended before, done or failed: it uses the results that exist.
        steps: environment steps of training in it.
    """

    kind: str
    subject: str
    needs: tuple[str, ...] = ()
    after: tuple[str, ...] = ()
    steps: int = 0

    @property
    def name(self) -> str:
        """Unique name within the benchmark."""
        return f"{self.kind}/{self.subject}"


def make_jobs(benchmark: Benchmark) -> list[Job]:
    """All jobs in the order to start them: trainings first, as they take longest."""
    matrix = benchmark.matrix
    cells = [Job(CELL, cell.name, steps=cell.steps) for cell in benchmark.cells]
    retrainings = [
        Job(RETRAINING, cell.name, needs=(f"{CELL}/{cell.name}",), steps=matrix.retraining.steps)
        for cell in benchmark.cells
        if matrix.retraining is not None
        and matrix.has("retraining", cell.game)
        and cell.method in (matrix.retraining.methods or matrix.methods)
        and cell.game in benchmark.baselines
    ]
    jobs = [*cells, *retrainings]
    if matrix.baseline:
        jobs += [
            Job(BASELINES, f"{game} {victim}")
            for game in benchmark.baselines
            for victim in matrix.victims[game]
        ]
    jobs += [
        Job(ADVERSARIES, f"{game} {label} {victim}")
        for game, named in matrix.adversaries.items()
        for label in named
        for victim in matrix.victims[game]
    ]
    for game in matrix.games:
        ends = tuple(f"{CELL}/{cell.name}" for cell in benchmark.cells_of(game))
        if matrix.has("crossplay", game):
            hardened = tuple(job.name for job in retrainings if job.needs[0] in ends)
            jobs.append(Job(CROSSPLAY, game, after=(*ends, *hardened)))
        if matrix.has("activations", game) and game in benchmark.baselines:  # the opponent of normal play
            jobs.append(Job(ACTIVATIONS, game, after=ends))
        if matrix.has("snapshots", game):
            jobs += [Job(SNAPSHOTS, end.partition("/")[2], needs=(end,)) for end in ends]
    return jobs


class JobStatus:
    """Status of jobs, read from the files on disk.

    Args:
        bench: the directory.
        benchmark: the resolved matrix.
    """

    def __init__(self, bench: BenchDir, benchmark: Benchmark):
        self.bench = bench
        self.benchmark = benchmark
        self.cells = {cell.name: cell for cell in benchmark.cells}
        self.command = ["apil", "bench", "run", str(bench.path)]

    def is_done(self, job: Job) -> bool:
        """Return whether nothing of it remains to be done.

        False if a file of its results is damaged: the job then fails and names it.
        """
        try:
            return bool(getattr(self, f"_{job.kind}_done")(job.subject))
        except ApilError:
            return False

    def trained(self, cell: Cell) -> bool:
        """Return whether a cell's training has used its budget, or was stopped early by a condition."""
        result = self.bench.cell(cell.name).result() or {}
        enough = bool(result.get("stopped")) or int(result.get("steps", 0)) >= cell.steps
        return result.get("status") == "finished" and enough

    def missing_scores(self, cell: Cell) -> dict[str, ScoreConfig]:
        """Scores of a trained cell that have not been played yet."""
        if self.bench.flat:  # the score a run ends with is all
            return {}
        run = self.bench.cell(cell.name)
        trained = int((run.result() or {}).get("steps", 0))
        scores = self.benchmark.matrix.scores_of(cell.game)
        return {
            name: wanted
            for name, wanted in scores.items()
            if not matches(read_score(run.path, name), wanted, cell, trained)
        }

    def missing_of(self, game: str, victim: str, label: str = BASELINE) -> dict[str, ScoreConfig]:
        """Scores of the adversary of that label, which is no cell, that have not been played yet."""
        cell = next(c for c in self.benchmark.cells_of(game) if c.victim == victim)
        scores = self.benchmark.matrix.scores_of(game)
        now = self.benchmark.adversaries(game)[label]
        found = {name: self.bench.adversary(game, name, victim, label) for name in scores}
        return {
            name: wanted
            for name, wanted in scores.items()
            # a baseline without weights is substituted until they are available
            if not matches(found[name], wanted, cell, None)
            or (":" in now and found[name].adversary.name != now)
        }

    def adversaries(self, game: str) -> dict[str, str]:
        """Label → name of all available attackers of a game: its baseline, those named, and the trained."""
        cells = [cell for cell in self.benchmark.cells_of(game) if self.trained(cell)]
        names = labels(self.benchmark.cells_of(game))  # untrained ones too, for fixed labels
        runs = {names[c.name]: f"run:{self.bench.cell(c.name).path.resolve()}" for c in cells}
        return {**self.benchmark.adversaries(game), **runs}

    def victims(self, game: str) -> dict[str, str]:
        """Label → name of the game's available victims: the original ones, and the retrained."""
        own = self.benchmark.matrix.victims[game]
        originals = {"original" if len(own) == 1 else f"original {name}": name for name in own}
        names = labels(self.benchmark.cells_of(game))
        hardened = {
            f"vs {label}": f"retrained:{self.bench.retrained_dir(cell).resolve()}"
            for cell, label in names.items()
            if self._retrained_done(cell)
        }
        return {**originals, **hardened}

    def _cells_done(self, name: str) -> bool:
        cell = self.cells[name]
        return self.trained(cell) and not self.missing_scores(cell)

    def _baseline_done(self, subject: str) -> bool:
        game, _, victim = subject.partition(" ")
        return not self.missing_of(game, victim)

    def _adversaries_done(self, subject: str) -> bool:
        game, label, victim = subject.split(" ", 2)
        return not self.missing_of(game, victim, label)

    def _retrained_done(self, name: str) -> bool:
        result = RunDir(self.bench.retrained_dir(name)).result() or {}
        stage = self.benchmark.matrix.retraining
        budget = 0 if stage is None else stage.steps
        return result.get("status") == "finished" and int(result.get("steps", 0)) >= budget

    def _crossplay_done(self, game: str) -> bool:
        from apil_core.evaluation.crossplay.document import CrossPlay

        found = CrossPlay.stored(self.bench.crossplay_path(game))
        if found is None or self.valid_crossplay(found, game) != found:
            return False
        return covers(found, self.adversaries(game), self.victims(game))

    def valid_crossplay(self, document: CrossPlay, game: str) -> CrossPlay:
        """The part of a cross-play that fits the present players and the matrix."""
        from apil_core.config.game import stored_physics
        from apil_core.studies.bench.still_valid import still_valid

        stage, cells = self.benchmark.matrix.crossplay, self.benchmark.cells_of(game)
        wanted = None if stage is None else (stage.episodes, stage.physics or stored_physics(cells[0].config))
        hashes = {f"vs {label}": self._hardened_sha256(name) for name, label in labels(cells).items()}
        hashes |= self._adversaries_sha256(game)
        return still_valid(document, self.adversaries(game), self.victims(game), hashes, wanted)

    def _adversaries_sha256(self, game: str) -> dict[str, str]:
        """Weight hashes of the trained cells by label; a raised budget changes them."""
        from apil_core.common.files import sha256

        cells = [cell for cell in self.benchmark.cells_of(game) if self.trained(cell)]
        names = labels(self.benchmark.cells_of(game))
        return {names[c.name]: sha256(self.bench.cell(c.name).newest_checkpoint()) for c in cells}

    def _hardened_sha256(self, cell_name: str) -> str:
        result = RunDir(self.bench.retrained_dir(cell_name)).result() or {}
        return str(result.get("hardened", {}).get("sha256", ""))

    def _activations_done(self, game: str) -> bool:
        from apil_core.studies.activations.models import ActivationMap
        from apil_core.studies.bench.still_valid import same_players

        found = ActivationMap.stored(self.bench.activations_path(game))
        stage = self.benchmark.matrix.activations
        if found is None or stage is None or found.games_per_opponent != stage.episodes:
            return False
        return same_players(found.players, self.adversaries(game), self._adversaries_sha256(game))

    def _snapshots_done(self, name: str) -> bool:
        return self.bench.snapshot_path(name).is_file()


def labels(cells: Sequence[Cell]) -> dict[str, str]:
    """Short labels of one game's cells by name: the method, plus what distinguishes its cells."""
    found = {}
    for cell in cells:
        alone = sum(other.method == cell.method for other in cells) == 1
        found[cell.name] = cell.method if alone else f"{cell.method}/{cell.name.rpartition('/')[2]}"
    return found


def matches(result: Any, wanted: ScoreConfig, cell: Cell, trained: int | None) -> bool:
    """Return whether a stored score has the required weights and settings.

    ``trained`` is ``None`` for an adversary that is no cell's, and so has no cell's observers.
    """
    from apil_core.config.game import stored_physics
    from apil_core.evaluation.results import observers_played, with_observers_played

    if result is None:
        return False
    modes = cell.config.evaluation
    asked = (
        wanted.episodes,
        (wanted.blind, None),
        {**({} if trained is None else observers_played(cell.config)), **wanted.observers},
        wanted.physics or stored_physics(cell.config),
        wanted.adversary_actions or modes.adversary_actions,
        wanted.victim_actions or modes.victim_actions,
        cell.victim,
        trained,
    )
    played = (
        result.episodes,
        (result.blind, result.blind_victim),
        (result if trained is None else with_observers_played(result, cell.config)).observers or {},
        result.physics,
        result.adversary_actions,
        result.victim_actions,
        result.victim.name,
        None if trained is None else result.trained_steps,
    )
    return asked == played


def covers(document: Any, adversaries: dict[str, str], victims: dict[str, str]) -> bool:
    """Return whether a cross-play has games of all these against each other."""
    if document is None:
        return False
    rows = {player.label for player in document.adversaries}
    columns = {player.label for player in document.victims}
    whole = all(score is not None for row in document.scores for score in row)
    return whole and set(adversaries) <= rows and set(victims) <= columns
