"""A benchmark's directory: its matrix, one run directory per cell, and the results of its stages."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from apil_core.common.errors import RunDirError
from apil_core.common.files import locked, read_json, write_atomically
from apil_core.common.trust import remember
from apil_core.studies.bench.matrix import BASELINE, Matrix, load_matrix
from apil_core.training.storage.run_dir import RunDir

if TYPE_CHECKING:
    from apil_core.studies.bench.cells import Cell

MATRIX_FILE, SEEDS_FILE = "matrix.yaml", "seeds.yaml"


@dataclass(frozen=True)
class CellDir:
    """One cell's run on disk, started or not.

    Attributes:
        cell: of the matrix.
        run: its run directory.
        failure: why the last attempt failed, or ``""``.
    """

    cell: Cell
    run: RunDir
    failure: str = ""

    @property
    def status(self) -> str:
        """``finished``, ``failed``, ``waiting`` (nothing there yet), or the status of the run's directory."""
        if self.failure:
            return "failed"
        if not self.run.config_path.is_file():
            return "waiting"
        return str(self.run.summary()["status"])


class BenchDir:
    """Paths and small files of one benchmark.

    Args:
        path: its directory; it need not exist yet.
        flat: of several seeds of one run, which lie directly in it; default: as it is on disk.
    """

    def __init__(self, path: Path | str, *, flat: bool | None = None):
        self.path = Path(path)
        self.flat = (self.path / SEEDS_FILE).is_file() if flat is None else flat
        self.matrix_path = self.path / (SEEDS_FILE if self.flat else MATRIX_FILE)
        self.logs = self.path / "logs"
        self.report = self.path / "report"

    def matrix(self) -> Matrix:
        """The stored, resolved matrix.

        Raises:
            RunDirError: this is no directory of a benchmark.
        """
        if not self.matrix_path.is_file():
            raise RunDirError(f"{self.path} is no benchmark (no {MATRIX_FILE} in it)")
        return load_matrix(str(self.matrix_path))

    def write_matrix(self, matrix: Matrix) -> None:
        """Write the resolved matrix, every key under a comment."""
        from apil_core.config.yaml import commented_yaml

        text = commented_yaml(matrix.model_dump(mode="json"), Matrix).encode()
        self.path.mkdir(parents=True, exist_ok=True)
        write_atomically(self.matrix_path, lambda file: file.write(text))
        remember(self.path)

    def cell(self, name: str) -> RunDir:
        """The run directory of a cell."""
        return RunDir(self.path / name.rpartition("/")[2] if self.flat else self.path / "cells" / name)

    def cells(self) -> list[CellDir]:
        """All cells of the matrix, run or not.

        Raises:
            ApilError: the matrix is damaged, or names something that is not installed.
        """
        from apil_core.studies.bench.cells import resolve_matrix

        benchmark = resolve_matrix(self.matrix(), str(self.matrix_path))
        return [
            CellDir(cell, self.cell(cell.name), self.failure(f"cells/{cell.name}"))
            for cell in benchmark.cells
        ]

    def adversary_dir(self, game: str, victim: str | None = None, label: str = BASELINE) -> Path:
        """Directory of the scores, against a victim, of an adversary that the benchmark does not train."""
        names = self.matrix().victims.get(game, ())
        first = not names or victim in (None, names[0])
        folder = self.path / (BASELINE if label == BASELINE else f"adversaries/{label}") / game
        return folder if first else folder / "_".join(str(victim).replace(":", "/").split("/"))

    def adversary(self, game: str, score: str, victim: str | None = None, label: str = BASELINE) -> Any:
        """That score of such an adversary, an ``EvaluationResult``, or ``None``."""
        return read_score(self.adversary_dir(game, victim, label), score)

    def retrained(self) -> list[Path]:
        """Directories of retrainings, started or finished."""
        return sorted(path.parent for path in (self.path / "retrained").glob("*/*/*/config.yaml"))

    def retrained_dir(self, cell_name: str) -> Path:
        """Directory of the victim retrained against a cell's adversary."""
        return self.path / "retrained" / cell_name

    def crossplay_path(self, game: str) -> Path:
        """Path of the games of every adversary against every victim."""
        return self.path / "crossplay" / f"{game}.json"

    def activations_path(self, game: str) -> Path:
        """Path of the victim's activations against each opponent."""
        return self.path / "activations" / f"{game}.json"

    def snapshot_path(self, cell_name: str) -> Path:
        """Path of the contact sheet of a cell's adversary."""
        return self.path / "snapshots" / f"{cell_name}.png"

    def set_aside(self, cell_name: str) -> None:
        """Move a cell's retraining to ``earlier/`` and delete its pictures, as the adversary has changed."""
        self.snapshot_path(cell_name).unlink(missing_ok=True)
        retrained, earlier = self.retrained_dir(cell_name), self.path / "earlier" / cell_name
        if retrained.is_dir():
            earlier.mkdir(parents=True, exist_ok=True)
            retrained.rename(earlier / f"{len(list(earlier.iterdir()))}")

    def log_path(self, job: str) -> Path:
        """Path of a job's output."""
        return self.logs / f"{job.replace('/', '_')}.log"

    def _failure_path(self, job: str) -> Path:
        return self.logs / f"{job.replace('/', '_')}.failed.json"

    def failure(self, job: str) -> str:
        """The reason why a job's last attempt failed, or ``""``."""
        path = self._failure_path(job)
        try:
            return str((read_json(path) or {"error": ""})["error"])
        except (RunDirError, KeyError):
            return f"unknown: {path} is damaged"

    def note_failure(self, job: str, error: str) -> None:
        """Store the reason of a job's failure; an empty text clears it."""
        path = self._failure_path(job)
        if not error:
            path.unlink(missing_ok=True)
            return
        self.logs.mkdir(parents=True, exist_ok=True)
        text = json.dumps({"error": error}).encode()
        write_atomically(path, lambda file: file.write(text))

    @contextmanager
    def lock(self) -> Iterator[None]:
        """Lock the benchmark against other schedulers; the lock of a killed one is released by itself.

        Raises:
            RunDirError: another one is at work here.
        """
        self.path.mkdir(parents=True, exist_ok=True)
        with locked(self.path / ".lock", f"another process is running the benchmark in {self.path}"):
            yield


def score_path(directory: Path, name: str) -> Path:
    """Path of the score of that name."""
    return directory / "scores" / f"{name}.json"


def read_score(directory: Path, name: str) -> Any:
    """Read a score, an ``EvaluationResult``; ``None`` if there is none.

    Raises:
        RunDirError: the file is damaged.
    """
    from apil_core.evaluation.results import EvaluationResult

    path = score_path(directory, name)
    if not path.is_file():
        return None
    try:
        return EvaluationResult.model_validate_json(path.read_bytes())
    except (OSError, ValueError) as error:
        raise RunDirError(f"{path} is damaged: {' '.join(str(error).split())}") from error


def write_score(directory: Path, name: str, result: Any) -> None:
    """Write a score atomically, in the directory of a run or an adversary."""
    write_result(score_path(directory, name), result)


def write_result(path: Path, result: Any) -> None:
    """Write a score atomically; the file's folder is made if it is not there."""
    path.parent.mkdir(parents=True, exist_ok=True)
    text = result.model_dump_json(indent=1).encode() + b"\n"
    write_atomically(path, lambda file: file.write(text))
