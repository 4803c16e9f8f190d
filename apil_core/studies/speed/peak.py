"""The largest memory of a stretch of work, as far as the system tells."""

from __future__ import annotations

from pathlib import Path

from apil_core.common.machine import MEGABYTE, resident_mb

_CLEAR = Path("/proc/self/clear_refs")
_STATUS = Path("/proc/self/status")
_PEAK = "5"
"""What Linux takes for: begin the peak anew."""


class PeakMemory:
    """Largest resident set of this process since it was made or asked last.

    A peak that only grows tells about the hungriest thing done so far; Linux can begin it anew. Elsewhere
    (or where that is forbidden) the value is the resident set at the time of asking.

    Attributes:
        exact: the system keeps watch.
        largest: of all values taken, MB.
    """

    def __init__(self) -> None:
        self.exact = _begin_anew()
        self.largest = resident_mb()

    def take(self) -> float:
        """The peak so far in MB; a new one begins."""
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
