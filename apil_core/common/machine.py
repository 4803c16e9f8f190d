"""How much memory the process holds."""

from __future__ import annotations

import psutil

MEGABYTE = 1_000_000
"""Bytes."""


def resident_mb() -> float:
    """Resident set of this process now, in MB of 10⁶ bytes; worker processes of a game are not in it."""
    return float(psutil.Process().memory_info().rss) / MEGABYTE
