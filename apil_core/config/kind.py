"""Distinction between directories of retrainings and of runs."""

from __future__ import annotations

import re
from pathlib import Path

from apil_core.common.errors import RunDirError

KIND = "retraining"
"""Value of ``kind`` in its ``config.yaml``; a run's has no such key."""


class IsRetrainingError(RunDirError):
    """A retraining's directory where a run's was expected."""


_MARK = re.compile(rf"^kind: {KIND}$", re.MULTILINE)


def is_retraining(path: Path) -> bool:
    """True if that directory is a retraining's, by its ``config.yaml``."""
    try:
        return _MARK.search((path / "config.yaml").read_text("utf-8")) is not None
    except (OSError, UnicodeDecodeError):
        return False
