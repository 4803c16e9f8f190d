"""The directory of a distillation: a run directory with blocks of games, student and report."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TypeVar

import torch
from pydantic import BaseModel, ValidationError
from safetensors import SafetensorError
from safetensors.torch import load_file, save

from apil_core.common.errors import RunDirError
from apil_core.common.files import write_atomically
from apil_core.common.trust import named_in
from apil_core.runs.distillation.config import DistillConfig
from apil_core.runs.distillation.learner import Block
from apil_core.runs.distillation.report import Report
from apil_core.training.storage.run_dir import RunDir

RESUME = "apil distill --resume"
Model = TypeVar("Model", bound=BaseModel)


class DistillDir(RunDir):
    """Paths and files of one distillation; its settings are in ``distillation.json``.

    Args:
        path: its directory; it need not exist yet.
    """

    def __init__(self, path: Path | str):
        super().__init__(path)
        self.config_path = self.path / "distillation.json"
        self.student_path = self.path / "student.safetensors"
        self.report_path = self.path / "report.json"

    @classmethod
    def begin(cls, path: Path, config: DistillConfig, command: Sequence[str]) -> DistillDir:
        """Create the directory.

        Raises:
            RunDirError: it exists and is not empty, or cannot be written.
        """
        made = cls(path)
        with made.make(RESUME):
            made.write_json(made.config_path, config.model_dump(mode="json"))
            made.note_environment(command)
        return made

    def settings(self) -> DistillConfig:
        """Read the settings that :meth:`begin` stored.

        Raises:
            RunDirError: this is no distillation's directory, or one that an older version began.
        """
        if not self.config_path.is_file():
            raise RunDirError(
                f"{self.path} is no distillation's directory (no {self.config_path.name} in it)"
            )
        config = _read(self.config_path, DistillConfig)
        named_in(self.config_path, config.model_dump())
        if not self.checkpoint_dir.is_dir():
            raise RunDirError(
                f"{self.path} was begun by an older version; begin anew in another --out, "
                f"with the settings in {self.config_path}"
            )
        return config

    def report(self) -> Report | None:
        """Read the report; ``None`` where there is none yet.

        Raises:
            RunDirError: it is damaged.
        """
        return _read(self.report_path, Report) if self.report_path.is_file() else None

    def block_path(self, number: int) -> Path:
        """Path of a round's block."""
        return self.path / f"block-{number:03d}.safetensors"

    def save_block(self, number: int, block: Block) -> None:
        """Store a block; blocks never change."""
        content = save({name: tensor.cpu().contiguous() for name, tensor in vars(block).items()})
        write_atomically(self.block_path(number), lambda file: file.write(content))

    def load_block(self, number: int, device: torch.device) -> Block:
        """Read a block.

        Raises:
            RunDirError: missing or damaged.
        """
        path = self.block_path(number)
        try:
            return Block(**load_file(path, str(device)))
        except (OSError, SafetensorError, TypeError) as error:
            raise RunDirError(
                f"{path} is missing or damaged: {error}; begin anew in another --out"
            ) from error

    def drop_blocks(self) -> None:
        """Delete the blocks, which a finished student no longer needs."""
        for path in self.path.glob("block-*.safetensors"):
            path.unlink(missing_ok=True)


def _read(path: Path, model: type[Model]) -> Model:
    try:
        return model.model_validate_json(path.read_bytes())
    except ValidationError as error:
        reason = error.errors()[0]["msg"]
        raise RunDirError(f"{path} is damaged or of another version: {reason}") from error
