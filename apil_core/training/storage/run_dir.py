"""The layout of a run on disk: ``<root>/<env>/<method>/<time>-s<seed>/``."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple, Self

from pydantic import BaseModel, ValidationError

from apil_core.api.config import RunConfig
from apil_core.common.documents import EXACT
from apil_core.common.errors import RunDirError
from apil_core.common.files import LOCK, is_taken, locked, read_json, unused, write_atomically
from apil_core.common.trust import remember
from apil_core.plugins.discovery import PluginRegistry
from apil_core.training.storage.environment import environment

DEFAULT_ROOT = Path("runs")
BEST = "best"
"""Name for the checkpoint with the highest win rate, in options that choose one."""
_TAIL = 1 << 18
"""Bytes at the end of a log that are searched for its newest row."""


class Held(NamedTuple):
    """A directory that is kept open, and its settings."""

    descriptor: int
    files: dict[str, bytes]


class RunDir:
    """Paths and small files of one run.

    Args:
        path: the run's directory; it need not exist yet.
    """

    def __init__(self, path: Path | str):
        self.path = Path(path)
        self.config_path = self.path / "config.yaml"
        self.metrics_path = self.path / "metrics.jsonl"
        self.result_path = self.path / "result.json"
        self.environment_path = self.path / "environment.json"
        self.checkpoint_dir = self.path / "checkpoints"
        self.best_path = self.checkpoint_dir / "best.pt"
        self.curve_path = self.path / "curve.png"
        self.won_game_path = self.path / "won-game.mp4"

    @classmethod
    def create(
        cls, config: RunConfig, out: Path | None, command: Sequence[str], plugins: PluginRegistry
    ) -> Self:
        """Make a fresh directory with the resolved config and the environment.

        Raises:
            RunDirError: it exists and is not empty, or cannot be written.
        """
        stamp = f"{time.strftime('%Y%m%d-%H%M%S')}-s{config.seed}"
        run_dir = cls(out or unused(DEFAULT_ROOT / config.env / cls._folder(config) / stamp))
        with run_dir.make("apil resume"):
            run_dir.write_config(config, plugins)
            run_dir.note_environment(command)
        return run_dir

    @staticmethod
    def _folder(config: RunConfig) -> str:
        """Folder of such runs, in the game's."""
        return config.method

    @contextmanager
    def make(self, resume: str) -> Iterator[None]:
        """Create the directory, and hold its lock while its first files are written, against races.

        Args:
            resume: command that resumes an existing run, for the message.

        Raises:
            RunDirError: it exists and is not empty, another process is creating it, or it is not writable.
        """
        taken = (
            f"{self.path} exists and is not empty; choose another --out, "
            f"or continue it with: {resume} {self.path}"
        )
        try:
            if is_taken(self.path):
                raise RunDirError(taken)
            self.path.mkdir(parents=True, exist_ok=True)
            with locked(self.path / LOCK, taken):
                if is_taken(self.path):
                    raise RunDirError(taken)
                self.checkpoint_dir.mkdir()
                yield
        except OSError as error:
            raise RunDirError(f"cannot create run directory {self.path}: {error.strerror}") from error

    def write_config(self, config: RunConfig, plugins: PluginRegistry) -> None:
        """Store the resolved configuration; ``plugins`` explain their options in its comments."""
        from apil_core.config.layers import write_copy
        from apil_core.config.resolve import dump_yaml

        text = dump_yaml(config, plugins)
        write_atomically(self.config_path, lambda file: file.write(text.encode()))
        write_copy(self.config_path, text)

    def note_environment(self, command: Sequence[str]) -> None:
        """Append this session (command, versions, host, git) to ``environment.json``."""
        try:
            sessions = read_json(self.environment_path, list) or []
        except RunDirError:  # informational: a damaged one must not prevent a resume
            self.environment_path.replace(self.environment_path.with_suffix(".json.damaged"))
            sessions = []
        sessions.append(environment(command))
        self.write_json(self.environment_path, sessions)
        remember(self.path)

    def config(self) -> RunConfig:
        """The stored configuration.

        Raises:
            RunDirError: this is no run directory.
        """
        if not self.config_path.is_file():
            raise RunDirError(f"{self.path} is no run directory (no config.yaml in it)")
        from apil_core.config.resolve import load_resolved

        return load_resolved(self.config_path)

    def checkpoints(self) -> list[Path]:
        """Complete checkpoints, oldest first."""
        return sorted(self.checkpoint_dir.glob("iteration-*.pt"))

    def checkpoint_path(self, iteration: int) -> Path:
        """Path of the checkpoint taken after that many iterations."""
        return self.checkpoint_dir / f"iteration-{iteration:08d}.pt"

    def newest_checkpoint(self) -> Path:
        """The last complete checkpoint.

        Raises:
            RunDirError: there is none.
        """
        found = self.checkpoints()
        if not found:
            raise RunDirError(
                f"{self.path} has no checkpoint: nothing to continue or evaluate; unless a process is still "
                "training there, delete it and begin again"
            )
        return found[-1]

    def checkpoint(self, wanted: Path | str | None) -> Path:
        """The newest one, the one that won most in evaluations during training (``best``), or the given one.

        Raises:
            RunDirError: there is none.
        """
        if wanted is None:
            return self.newest_checkpoint()
        if str(wanted) != BEST:
            return Path(wanted)
        if not self.best_path.is_file():
            raise RunDirError(
                f"{self.path} has no best checkpoint: it is kept by evaluations during training "
                "(--set evaluation.every_steps=N)"
            )
        return self.best_path

    def abandon_after(self, iteration: int) -> None:
        """Set aside checkpoints later than ``iteration``: the run resumes there and takes another course."""
        for path in self.checkpoints():
            if path.name > self.checkpoint_path(iteration).name:
                for part in (path, *self._parts(path.name)):
                    part.replace(part.with_name(f"{part.name}.abandoned"))

    def retire_result(self, now: int) -> None:
        """Rename results of an earlier end to ``result-<steps>.json`` etc., as the run continues.

        Results from after the resumed checkpoint get ``.abandoned``: their scores are of a discarded course.

        Args:
            now: environment steps at the resume.
        """
        if self.result_path.is_file():
            try:
                steps = int((self.result() or {}).get("steps", now))
            except RunDirError:  # damaged; the run continues nevertheless
                steps = now
            for path in (self.result_path, self.curve_path, self.won_game_path):
                if path.is_file():
                    path.replace(path.with_stem(f"{path.stem}-{steps}"))
        for path in self._retired():
            if int(path.stem.removeprefix("result-")) > now:
                path.replace(path.with_suffix(".json.abandoned"))

    def _retired(self) -> list[Path]:
        """Results of earlier ends."""
        found = sorted(self.path.glob("result-*.json"))
        return [path for path in found if path.stem.removeprefix("result-").isdecimal()]

    @contextmanager
    def lock(self) -> Iterator[None]:
        """Lock the directory against other processes; a killed process releases it.

        Raises:
            RunDirError: another process is training here.
        """
        with locked(self.path / LOCK, f"another process is training in {self.path}"):
            yield

    def hold(self) -> Held:
        """Open the directory and read its settings, so that :meth:`found` finds or makes it again."""
        files = [path for path in (self.config_path, self.environment_path) if path.is_file()]
        kept = {path.name: path.read_bytes() for path in files}
        return Held(os.open(self.path, os.O_RDONLY), kept)

    def found(self, held: Held) -> Self:
        """This directory where it is now; a new one if it is gone."""
        for path in (self.path, Path(f"/proc/self/fd/{held.descriptor}")):
            with suppress(OSError):
                if os.path.samestat(os.fstat(held.descriptor), path.stat()) and path.resolve().is_dir():
                    return self if path == self.path else type(self)(path.resolve())
        fresh = type(self)(unused(self.path))
        fresh.checkpoint_dir.mkdir(parents=True)
        for name, content in held.files.items():
            (fresh.path / name).write_bytes(content)
        return fresh

    def prune(self, keep: int) -> None:
        """Delete all but the newest ``keep`` checkpoints, and parts of incomplete ones."""
        for old in self.checkpoints()[:-keep]:
            old.unlink(missing_ok=True)
        for part in self._parts("iteration-*.pt"):
            if not part.with_suffix("").is_file():
                part.unlink(missing_ok=True)

    def _parts(self, pattern: str) -> list[Path]:
        """Files of processes other than the first beside checkpoints of that name."""
        found = self.checkpoint_dir.glob(f"{pattern}.rank*")
        return [part for part in found if part.suffix.removeprefix(".rank").isdecimal()]

    def write_json(self, path: Path, value: Any) -> None:
        """Write ``value`` as JSON, atomically."""
        text = json.dumps(value, indent=2, default=str).encode() + b"\n"
        write_atomically(path, lambda file: file.write(text))

    def result(self) -> dict[str, Any] | None:
        """Content of ``result.json``, or ``None`` before the first end.

        Raises:
            RunDirError: it is damaged.
        """
        return _result(self.result_path)

    def results(self) -> dict[Path, dict[str, Any]]:
        """Results by file: the last end's, and earlier ones' if the run was extended.

        Raises:
            RunDirError: one of them is damaged.
        """
        paths = [*self._retired(), self.result_path]
        return {path: value for path in paths if (value := _result(path))}

    def victim(self) -> str:
        """Name of the policy under attack, as the run's score has it; before that, as configured.

        Raises:
            RunDirError: this is no run directory.
        """
        return scored_victim(self.summary()) or self.config().victim

    def processes(self) -> int:
        """Number of processes that train it together; 1 if unknown."""
        # informational: a damaged one must not make the run unreadable
        with suppress(RunDirError, LookupError, TypeError, ValueError):
            return int(read_json(self.environment_path, list)[-1]["processes"])
        return 1

    def summary(self) -> dict[str, Any]:
        """Name, status and progress for listings; never raises for a half-written run."""
        last, damage = self._last_metrics()
        unfinished = damage or ("running or killed" if last else "empty")
        try:
            result = self.result() or {}
        except RunDirError as error:
            result, unfinished = {}, str(error)
        return {
            "path": str(self.path),
            "status": damage or result.get("status", unfinished),
            "stopped": result.get("stopped", ""),
            "steps": int(last.get("steps", result.get("steps", 0))),
            "evaluation": result.get("evaluation"),
            "white_box": bool(result.get("white_box")),
        }

    def last_metrics(self) -> dict[str, Any]:
        """The numbers in the newest complete row of ``metrics.jsonl``, or an empty dict."""
        return self._last_metrics()[0]

    def _last_metrics(self) -> tuple[dict[str, Any], str]:
        """The newest row that can be read, and what is wrong with a newer one, or ``""``."""
        damage = ""
        try:
            with self.metrics_path.open("rb") as file:
                file.seek(max(file.seek(0, os.SEEK_END) - _TAIL, 0))
                lines = file.read().decode("utf-8", errors="replace").splitlines()
        except FileNotFoundError:
            lines = []
        except OSError as error:
            lines, damage = [], f"{self.metrics_path} cannot be read: {error.strerror}"
        for line in reversed(lines):
            try:
                row = {name: value for name, value in json.loads(line).items() if value is not None}
                if all(isinstance(value, (int, float)) for value in row.values()):
                    int(row.get("steps", 0))
                    return row, damage
            except json.JSONDecodeError:
                continue  # a line cut short by a kill, or by the start of the tail
            except (ValueError, AttributeError, ArithmeticError, RecursionError):
                pass
            damage = damage or f"{self.metrics_path}: damaged line"
        return {}, damage


class _Named(BaseModel):
    name: str = ""


class _Rate(BaseModel):
    value: float


class _Score(BaseModel):
    victim: _Named = _Named()
    win_rate: _Rate | None = None
    win_or_tie_rate: _Rate | None = None


class _Result(BaseModel):
    """Fields of ``result.json`` that listings and benchmarks read."""

    model_config = EXACT

    status: str = ""
    steps: int = 0
    stopped: str = ""
    evaluation: _Score | None = None
    hardened: dict[str, Any] = {}


def _result(path: Path) -> dict[str, Any] | None:
    value: dict[str, Any] | None = read_json(path)
    try:
        _Result.model_validate(value or {})
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(map(str, first["loc"]))
        raise RunDirError(f"{path} is damaged: {key}: {first['msg']}") from error
    return value


def scored_victim(summary: Mapping[str, Any]) -> str:
    """Name of the victim of a run's score, or ``""`` before there is one."""
    score = summary["evaluation"] or {}
    return str(score.get("victim", {}).get("name", ""))


def part_of_rank(path: Path, rank: int) -> Path:
    """Path of a rank's part of the checkpoint; ``path`` is the first one's."""
    return path if rank == 0 else path.with_name(f"{path.name}.rank{rank}")
