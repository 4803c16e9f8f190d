"""Memory and CPUs of the process."""

from __future__ import annotations

import os

import psutil

MEGABYTE = 1_000_000
"""In bytes."""


def resident_mb() -> float:
    """Resident set of this process now, in MB of 10⁶ bytes; worker processes of a game are not in it."""
    return float(psutil.Process().memory_info().rss) / MEGABYTE


def threads_each(workers: int) -> int:
    """Threads for each of several processes that share the usable CPUs."""
    return max(usable_cpus() // workers, 1)


def usable_cpus() -> int:
    """CPUs this process may run on."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
