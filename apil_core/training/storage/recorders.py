"""Sinks for metrics: JSON lines (read by all other tools) and TensorBoard."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from apil_core.common.errors import RunDirError


class JsonlRecorder:
    """One JSON object per row in ``metrics.jsonl``, flushed so that a kill loses at most one.

    NaN and infinities, for which JSON has no numbers, become ``null``.

    Args:
        run_dir: an existing directory; a file in it is continued.

    Raises:
        RunDirError: the file cannot be opened or written.
    """

    def __init__(self, run_dir: Path):
        self.path = Path(run_dir) / "metrics.jsonl"
        try:
            self._file = self.path.open("a", encoding="utf-8")
        except OSError as error:
            raise RunDirError(f"cannot write {self.path}: {error.strerror}") from error

    def record(self, metrics: Mapping[str, float]) -> None:
        """Append one line."""
        line = json.dumps({key: _json_safe(value) for key, value in metrics.items()}, allow_nan=False)
        try:
            if not os.fstat(self._file.fileno()).st_nlink:
                raise RunDirError(f"{self.path} was deleted during training; its rows until now are lost")
            self._file.write(line + "\n")
            self._file.flush()
        except OSError as error:
            raise RunDirError(f"cannot write {self.path}: {error.strerror}") from error

    def close(self) -> None:
        """Close the file; may be called twice."""
        self._file.close()


class TensorBoardRecorder:
    """Every metric as a scalar over environment steps, in ``<run_dir>/tensorboard``.

    Args:
        run_dir: an existing directory. After a resume a second event file continues where the first
            ended; points that the first row replaces are hidden (``purge_step``).
    """

    def __init__(self, run_dir: Path):
        self.log_dir = Path(run_dir) / "tensorboard"
        self._writer: Any = None

    def record(self, metrics: Mapping[str, float]) -> None:
        """Write all scalars at ``metrics["steps"]``."""
        step = int(metrics["steps"])
        if self._writer is None:
            from torch.utils.tensorboard import SummaryWriter

            first = step - int(metrics.get("row_steps", 1)) + 1
            try:
                self._writer = SummaryWriter(str(self.log_dir), purge_step=first)
            except OSError as error:
                raise RunDirError(f"cannot write {self.log_dir}: {error.strerror}") from error
        for key, value in metrics.items():
            self._writer.add_scalar(key, float(value), step)

    def close(self) -> None:
        """Flush and close the event file; may be called twice."""
        if self._writer is not None:
            self._writer.close()
            self._writer = None


def read_metrics(path: Path) -> list[dict[str, float]]:
    """All complete lines of a ``metrics.jsonl``, ``null`` as NaN; a last line cut short is left out.

    Raises:
        RunDirError: the file is missing, or a line before the last is damaged or has no ``steps``.
    """
    rows = []
    for number, line in enumerate(_lines(path), 1):
        row = _parse(line)
        try:
            if row is None or not math.isfinite(row["steps"]):
                raise ValueError
            rows.append({key: math.nan if value is None else float(value) for key, value in row.items()})
        except (KeyError, TypeError, ValueError) as error:
            raise RunDirError(f"{path}:{number}: damaged line") from error
    return rows


def truncate_metrics(path: Path, after_iteration: int) -> None:
    """Drop the lines of iterations later than ``after_iteration``, atomically.

    A run resumed from a checkpoint writes those iterations again; without this they would be in the
    file twice. A half-written last line is dropped as well; a missing file stays missing.

    Args:
        path: the ``metrics.jsonl``.
        after_iteration: the last value of ``iteration`` to keep; −1 keeps none.
    """
    if not path.exists():
        return
    from apil_core.common.files import write_atomically

    rows = [(line, _parse(line)) for line in _lines(path)]
    kept = [line for line, row in rows if row is not None and row.get("iteration", 0) <= after_iteration]
    text = "".join(f"{line}\n" for line in kept).encode()
    write_atomically(path, lambda file: file.write(text))


def _lines(path: Path) -> list[str]:
    try:
        text = path.read_text("utf-8", errors="replace")
    except OSError as error:
        raise RunDirError(f"cannot read {path}: {error.strerror}") from error
    # Complete lines end in a newline: what follows the last one was cut short.
    return text.split("\n")[:-1]


def _parse(line: str) -> dict[str, Any] | None:
    try:
        row = json.loads(line)
    except json.JSONDecodeError:
        return None
    return row if isinstance(row, dict) else None


def _json_safe(value: float) -> float | None:
    return value if math.isfinite(value) else None
