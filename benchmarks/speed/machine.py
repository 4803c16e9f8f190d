"""The machine, its load, and the peak memory of a section of code."""

from __future__ import annotations

import os
import platform
from importlib import metadata
from pathlib import Path

from apil_core.common.machine import MEGABYTE, resident_mb, usable_cpus

from .report import Machine

_CLEAR = Path("/proc/self/clear_refs")
_STATUS = Path("/proc/self/status")
_PEAK = "5"
"""Makes Linux reset the peak."""

_PACKAGES = ("apil", "mujoco", "torch", "numpy", "rsl-rl-lib", "pluggy")


def this_machine() -> Machine:
    """Describe this machine and its load."""
    load = os.getloadavg()[0]
    return Machine(
        cpu=_cpu(),
        cpus=os.cpu_count() or 1,
        usable_cpus=usable_cpus(),
        platform=platform.platform(),
        python=platform.python_version(),
        versions={name: metadata.version(name) for name in _PACKAGES},
        load_before=load,
        load_after=load,
    )


def _cpu() -> str:
    """The processor's name; Python's own answer is empty on most Linux machines."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, platform.processor() or platform.machine())


class PeakMemory:
    """Largest resident set of this process since construction or the last :meth:`take`.

    Linux can reset the peak, so that each value belongs to one section of code. Elsewhere (or where that is
    forbidden) the value is the resident set at the time of the call.

    Attributes:
        exact: whether the peak can be reset.
        largest: of all values taken, MB.
    """

    def __init__(self) -> None:
        self.exact = _begin_anew()
        self.largest = resident_mb()

    def take(self) -> float:
        """Return the peak so far in MB, and reset it."""
        peak = _peak_mb() if self.exact else resident_mb()
        _begin_anew()
        self.largest = max(self.largest, peak)
        return peak


def _begin_anew() -> bool:
    try:
        _CLEAR.write_text(_PEAK)
    except OSError:
        return False
    return True


def _peak_mb() -> float:
    line = next(line for line in _STATUS.read_text().splitlines() if line.startswith("VmHWM:"))
    return int(line.split()[1]) * 1024 / MEGABYTE
