"""A run's data for experiment trackers, and the file that stores its identity there."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from apil_core.common.errors import ApilError
from apil_core.config.kind import is_retraining
from apil_core.training.storage.run_dir import RunDir

PROJECT = "apil"
"""Default project."""


@dataclass(frozen=True)
class TrackedRun:
    """A run's data for trackers.

    Attributes:
        run_dir: its directory.
        name: that directory's name.
        group: game and method (or ``retraining``), which runs to compare have in common.
        tags: game and method apart.
        config: the resolved configuration, nested, as JSON has it.
    """

    run_dir: RunDir
    name: str
    group: str
    tags: tuple[str, ...]
    config: dict[str, Any]

    @classmethod
    def of(cls, path: Path) -> TrackedRun:
        """Read it from the directory of a run or a retraining.

        Raises:
            RunDirError: it is neither.
        """
        from apil_core.runs.retraining.folder import RetrainDir

        run_dir = RetrainDir(path) if is_retraining(path) else RunDir(path)
        config = run_dir.config()
        tags = (config.env, config.method)
        return cls(run_dir, path.resolve().name, "/".join(tags), tags, config.model_dump(mode="json"))

    def where(self, tracker: str) -> dict[str, str]:
        """Read what :meth:`note_where` stored; empty before that, or if the file is damaged."""
        try:
            value = json.loads(self._path(tracker).read_text("utf-8"))
        except (OSError, ValueError):
            return {}
        return value if isinstance(value, dict) else {}

    def note_where(self, tracker: str, where: dict[str, str]) -> None:
        """Store the run's identity at the tracker, so that a resumed run continues it."""
        self.run_dir.write_json(self._path(tracker), where)

    def _path(self, tracker: str) -> Path:
        return self.run_dir.path / f"{tracker}.json"


@contextmanager
def one_line(tracker: str, hint: str) -> Iterator[None]:
    """Turn any exception of a tracker into one line with a remedy.

    Raises:
        ApilError: something was raised.
    """
    try:
        yield
    except ApilError:
        raise
    except Exception as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise ApilError(f"recorder {tracker}: {reason} ({hint})") from error
