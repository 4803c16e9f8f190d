"""The processor: how much of it is ours, and how many threads libraries take."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

from apil_core.cli.doctor_checks.finding import Finding, good, warning
from apil_core.cli.doctor_checks.scope import Scope
from apil_core.common.machine import usable_cpus

_THREADS = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")
_V1 = Path("/sys/fs/cgroup/cpu")
_V2 = Path("/sys/fs/cgroup")


def check(scope: Scope) -> Iterator[Finding]:
    """CPUs of the machine, those this process may use, and what keeps it from them."""
    total, usable = os.cpu_count() or 1, usable_cpus()
    limit = container_limit(Path("/proc/self/cgroup"), _V2, _V1)
    yield judge(total, usable, limit)
    load = os.getloadavg()[0]
    if load > usable / 2:
        detail = f"other programs keep {load:.1f} CPUs busy: step rates below are lower than they could be"
        yield warning("cpu: load", detail, "measure again when the machine is idle")
    settings = [f"{name}={os.environ[name]}" for name in _THREADS if name in os.environ]
    if settings:
        use = "networks run on one thread anyway, physics on --threads"
        yield good("cpu: threads", f"{', '.join(settings)}; {use}")


def judge(total: int, usable: int, limit: float | None) -> Finding:
    """What to say of a machine's CPUs.

    Args:
        total: CPUs of the machine.
        usable: those this process may run on.
        limit: CPUs' worth of time its container gets, or ``None``.
    """
    text = f"{total} CPUs" if usable == total else f"{usable} of {total} CPUs may be used"
    if limit is None or limit >= usable:
        return good("cpu", text)
    threads = max(1, int(limit))
    detail = f"{text}, but this container gets the time of {limit:g}: more physics threads only wait"
    return warning("cpu", detail, f"--threads {threads}")


def container_limit(membership: Path, v2: Path, v1: Path) -> float | None:
    """CPUs' worth of time that control groups grant, or ``None`` without a limit.

    Args:
        membership: ``/proc/self/cgroup``.
        v2: root of the groups of version 2.
        v1: root of the ``cpu`` controller of version 1.
    """
    try:
        lines = membership.read_text().splitlines()
    except OSError:  # no Linux
        return None
    limits = []
    for _, controllers, path in (line.split(":", 2) for line in lines):
        if not controllers:
            limits += [_v2_limit(folder) for folder in _upwards(v2, path)]
        elif "cpu" in controllers.split(","):
            limits += [_v1_limit(folder) for folder in _upwards(v1, path)]
    return min((limit for limit in limits if limit is not None), default=None)


def _upwards(root: Path, path: str) -> list[Path]:
    """A group's folder and those above it: each of them may limit it."""
    folder = root / path.lstrip("/")
    return [folder, *(above for above in folder.parents if above == root or root in above.parents)]


def _v2_limit(folder: Path) -> float | None:
    words = _words(folder / "cpu.max")
    return int(words[0]) / int(words[1]) if len(words) == 2 and words[0] != "max" else None


def _v1_limit(folder: Path) -> float | None:
    quota, period = _words(folder / "cpu.cfs_quota_us"), _words(folder / "cpu.cfs_period_us")
    return int(quota[0]) / int(period[0]) if quota and period and int(quota[0]) > 0 else None


def _words(file: Path) -> list[str]:
    try:
        return file.read_text().split()
    except OSError:
        return []
