"""Fixtures all tests share."""

from __future__ import annotations

import os
from pathlib import Path

# before torch is imported: two test workers with a thread pool each would fight for two cores
os.environ.setdefault("OMP_NUM_THREADS", "1")

import pytest


@pytest.fixture(scope="session")
def zoo_dir() -> Path:
    """Folder ``agent-zoo`` of the pretrained agents, in ``$APIL_ZOO`` or ``<repository>/../shared/zoo``."""
    beside = Path(__file__).resolve().parents[2] / "shared" / "zoo"
    root = Path(os.environ.get("APIL_ZOO", beside))
    for candidate in (root, root / "agent-zoo"):
        if (candidate / "kick-and-defend").is_dir():
            return candidate
    pytest.skip(f"no zoo weights in {root} (set APIL_ZOO to the folder agent-zoo)")
