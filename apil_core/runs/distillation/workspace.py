"""The directory of a distillation: settings, what was played, the state to go on from, student, report."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pydantic import ValidationError
from safetensors import SafetensorError
from safetensors.torch import load_file, save
from torch import Tensor

from apil_core.common.errors import RunDirError
from apil_core.common.files import is_taken, locked, write_atomically
from apil_core.common.trust import named_in, remember
from apil_core.runs.distillation.config import DistillConfig
from apil_core.runs.distillation.report import Report
from apil_core.training.storage import checkpoint
from apil_core.training.storage.run_dir import environment


class Workspace:
    """Paths and files of one distillation.

    Args:
        path: its directory; it need not exist yet.
    """

    def __init__(self, path: Path | str):
        self.path = Path(path)
        self.settings_path = self.path / "distillation.json"
        self.environment_path = self.path / "environment.json"
        self.state_path = self.path / "state.pt"
        self.student_path = self.path / "student.safetensors"
        self.report_path = self.path / "report.json"

    @classmethod
    def create(cls, path: Path, config: DistillConfig, command: Sequence[str]) -> Workspace:
        """A fresh directory.

        Raises:
            RunDirError: it exists and is not empty, or cannot be written.
        """
        space = cls(path)
        try:
            if is_taken(path):
                raise RunDirError(
                    f"{path} exists and is not empty; choose another --out, "
                    f"or continue it with: apil distill --resume {path}"
                )
            path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise RunDirError(f"cannot create {path}: {error.strerror}") from error
        space._write(space.settings_path, config.model_dump(mode="json"))
        space._write(space.environment_path, environment(command))
        remember(path)
        return space

    def settings(self) -> DistillConfig:
        """What :meth:`create` stored.

        Raises:
            RunDirError: this is no distillation's directory.
        """
        if not self.settings_path.is_file():
            raise RunDirError(
                f"{self.path} is no distillation's directory (no {self.settings_path.name} in it)"
            )
        try:
            stored = DistillConfig.model_validate_json(self.settings_path.read_bytes())
            named_in(self.settings_path, stored.model_dump())
            return stored
        except ValidationError as error:
            reason = error.errors()[0]["msg"]
            raise RunDirError(f"{self.settings_path} is damaged or of another version: {reason}") from error

    @contextmanager
    def lock(self) -> Iterator[None]:
        """Hold the directory against other processes.

        Raises:
            RunDirError: another one works here.
        """
        with locked(self.path / ".lock", f"another process is distilling in {self.path}"):
            yield

    def block_path(self, number: int) -> Path:
        """Where what was played in that round goes."""
        return self.path / f"block-{number:03d}.safetensors"

    def save_block(self, number: int, tensors: Mapping[str, Tensor]) -> None:
        """Keep a block; blocks never change."""
        content = save({name: tensor.cpu().contiguous() for name, tensor in tensors.items()})
        write_atomically(self.block_path(number), lambda file: file.write(content))

    def load_block(self, number: int) -> dict[str, Tensor]:
        """Read a block back.

        Raises:
            RunDirError: missing or damaged.
        """
        path = self.block_path(number)
        try:
            return load_file(path)
        except (OSError, SafetensorError) as error:
            raise RunDirError(
                f"{path} is missing or damaged: {error}; begin anew in another --out"
            ) from error

    def save_state(self, state: dict[str, Any]) -> None:
        """Keep the state between two stages."""
        checkpoint.save(self.state_path, state)

    def state(self) -> dict[str, Any] | None:
        """The newest state, or ``None`` before the first stage ended."""
        return checkpoint.read(self.state_path) if self.state_path.is_file() else None

    def write_report(self, report: Mapping[str, Any]) -> None:
        """Keep the report."""
        self._write(self.report_path, report)

    def report(self) -> Report | None:
        """The report, or ``None`` where there is none yet.

        Raises:
            RunDirError: it is damaged.
        """
        if not self.report_path.is_file():
            return None
        try:
            return Report.model_validate_json(self.report_path.read_bytes())
        except ValidationError as error:
            reason = error.errors()[0]["msg"]
            raise RunDirError(f"{self.report_path} is damaged or of another version: {reason}") from error

    def drop_blocks(self) -> None:
        """Delete what was played: a finished student needs it no more."""
        for path in self.path.glob("block-*.safetensors"):
            path.unlink()

    def _write(self, path: Path, value: Any) -> None:
        text = json.dumps(value, indent=2, default=str).encode() + b"\n"
        write_atomically(path, lambda file: file.write(text))
