"""The runs in and below directories."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from apil_core.common.errors import RunDirError
from apil_core.training.storage.run_dir import DEFAULT_ROOT, RunDir


def list_runs(root: Path = DEFAULT_ROOT) -> list[RunDir]:
    """All directories of runs and retrainings below ``root``, by path; those behind links too, each once."""
    found, seen = [], set()
    for folder, names, files in os.walk(root, followlinks=True):
        if (real := os.path.realpath(folder)) in seen:
            names.clear()
            continue
        seen.add(real)
        names.sort(key=lambda name: (os.path.islink(os.path.join(folder, name)), name))  # links last
        if "config.yaml" in files:
            found.append(Path(folder))
    return [RunDir(path) for path in sorted(found)]


def runs_in(directories: Sequence[Path]) -> list[RunDir]:
    """The runs that these directories are, or contain.

    Raises:
        RunDirError: one is neither.
    """
    found: list[RunDir] = []
    for directory in directories:
        below = [RunDir(directory)] if (directory / "config.yaml").is_file() else list_runs(directory)
        if not below:
            raise RunDirError(f"{directory} is no run directory (no config.yaml in it), nor has it any below")
        found += below
    return found
