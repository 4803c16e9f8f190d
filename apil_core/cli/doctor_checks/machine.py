"""Checks of the machine: Python, packages, processor, the learner's libraries with their GPU, and disk."""

from __future__ import annotations

import os
import platform
import shutil
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from packaging.version import Version

from apil_core.cli.doctor_checks import Finding, Scope, Status
from apil_core.cli.doctor_checks.probes import TrialError, attempt
from apil_core.common.extras import install_command
from apil_core.common.files import why_unwritable
from apil_core.common.machine import usable_cpus

NEWEST = "3.13"
"""Newest Python version with resolved dependencies."""

ENOUGH = 2**30
"""Bytes of free space below which a warning is given."""

_FIRST = ("torch", "mujoco", "numpy", "rsl-rl-lib")
"""Packages that affect scores most, listed first."""

_THREADS = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")
_GROUPS = Path("/sys/fs/cgroup")


def python(scope: Scope) -> Iterator[Finding]:
    """Check that this Python version is supported."""
    try:
        wanted = (metadata.metadata("apil").get_all("Requires-Python") or [""])[0]
    except metadata.PackageNotFoundError:
        wanted = ""  # reported by the check of the packages
    yield judge_python(platform.python_version(), wanted, sys.executable)


def judge_python(version: str, wanted: str, executable: str) -> Finding:
    """Judge Python ``version`` where the distribution requires ``wanted``, e.g. ``">=3.11"``."""
    text = f"{version} ({executable})"
    if not SpecifierSet(wanted).contains(version, prereleases=True):
        remedy = "make a new environment with that Python"
        return Finding("python", "error", f"{text}, but {wanted} is needed", remedy)
    if Version(version).release[:2] > Version(NEWEST).release:
        remedy = f"if it fails, use {NEWEST}"
        return Finding("python", "warning", f"{text} is newer than any we looked at", remedy)
    return Finding("python", "ok", text)


@dataclass(frozen=True)
class Package:
    """A requirement, and the version installed (``None``: none is)."""

    requirement: Requirement
    found: str | None

    @property
    def fits(self) -> bool:
        """Return whether a required version is installed."""
        return self.found is not None and self.requirement.specifier.contains(self.found, prereleases=True)

    @property
    def asked(self) -> str:
        """The requirement as pip takes it, e.g. ``"numpy>=2.0"``."""
        return f"{self.requirement.name}{self.requirement.specifier}"

    def __str__(self) -> str:
        return f"{self.requirement.name} {self.found}"


def packages(scope: Scope) -> Iterator[Finding]:
    """All required packages in one line, each missing or wrong one in its own, and a line for each extra."""
    try:
        distribution = metadata.distribution("apil")
    except metadata.PackageNotFoundError:
        yield Finding("packages", "error", "apil is not installed in this Python", "pip install -e .")
        return
    requirements = distribution.requires or []
    required = packages_of(requirements)
    fitting = [package for package in required if package.fits]
    versions = ", ".join(map(str, fitting)) or "none"
    yield Finding("packages", "ok", f"{len(fitting)} of {len(required)} as required: {versions}")
    for package in required:
        if not package.fits:
            here = f"is {package.found} here" if package.found else "is not installed"
            detail = f"{package.requirement.name} {here}, {package.asked} is needed"
            yield Finding("packages", "error", detail, f"pip install -c constraints.txt '{package.asked}'")
    for extra in distribution.metadata.get_all("Provides-Extra") or []:
        optional = packages_of(requirements, extra)
        missing = ", ".join(package.asked for package in optional if not package.fits)
        detail, remedy = f"here: {', '.join(map(str, optional)) or 'none'}", ""
        if missing:
            detail = f"not here (optional), misses {missing}"
            remedy = install_command(extra)
        yield Finding(f"extra: {extra}", "ok", detail, remedy)


def packages_of(requirements: Iterable[str], extra: str = "") -> list[Package]:
    """Packages that ``requirements`` name for this machine: without extras, or by ``extra`` alone."""

    def applies(requirement: Requirement, extra: str) -> bool:
        return requirement.marker is None or requirement.marker.evaluate({"extra": extra})

    parsed = [Requirement(text) for text in requirements]
    chosen = [one for one in parsed if applies(one, extra) and not (extra and applies(one, ""))]
    order = {name: place for place, name in enumerate(_FIRST)}
    chosen.sort(key=lambda one: (order.get(one.name, len(order)), one.name))
    return [Package(one, _version(one.name)) for one in chosen]


def _version(name: str) -> str | None:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None


def cpu(scope: Scope) -> Iterator[Finding]:
    """Check the machine's CPUs, those usable by this process, and the limit that applies."""
    usable = usable_cpus()
    limit = container_limit(Path("/proc/self/cgroup"), _GROUPS, _GROUPS / "cpu")
    yield judge_cpus(os.cpu_count() or 1, usable, limit)
    load = os.getloadavg()[0]
    if load > usable / 2:
        detail = f"other programs keep {load:.1f} CPUs busy: step rates below are lower than they could be"
        yield Finding("cpu: load", "warning", detail, "measure again when the machine is idle")
    settings = [f"{name}={os.environ[name]}" for name in _THREADS if name in os.environ]
    if settings:
        use = "networks run on one thread anyway, physics on --threads"
        yield Finding("cpu: threads", "ok", f"{', '.join(settings)}; {use}")


def judge_cpus(total: int, usable: int, limit: float | None) -> Finding:
    """Judge ``total`` CPUs, ``usable`` of them available, where a container has the CPU time of ``limit``."""
    text = f"{total} CPUs" if usable == total else f"{usable} of {total} CPUs may be used"
    if limit is None or limit >= usable:
        return Finding("cpu", "ok", text)
    detail = f"{text}, but this container gets the time of {limit:g}: more physics threads only wait"
    return Finding("cpu", "warning", detail, f"--threads {max(1, int(limit))}")


def container_limit(membership: Path, v2: Path, v1: Path) -> float | None:
    """Return the CPU quota, in CPUs, of this control group and its parents, or ``None`` without a limit.

    Args:
        membership: ``/proc/self/cgroup``.
        v2: root of the groups of version 2.
        v1: root of the ``cpu`` controller of version 1.
    """
    limits = []
    for line in _text(membership).splitlines():
        _, controllers, path = line.split(":", 2)
        if controllers and "cpu" not in controllers.split(","):
            continue
        root = v1 if controllers else v2
        folder = root / path.lstrip("/")
        for group in (folder, *(above for above in folder.parents if above == root or root in above.parents)):
            files = ("cpu.cfs_quota_us", "cpu.cfs_period_us") if controllers else ("cpu.max",)
            words = [word for name in files for word in _text(group / name).split()]
            if len(words) == 2 and words[0] not in ("max", "-1"):
                limits.append(int(words[0]) / int(words[1]))
    return min(limits, default=None)


def _text(file: Path) -> str:
    try:
        return file.read_text()
    except OSError:
        return ""


def learner(scope: Scope) -> Iterator[Finding]:
    """Check that training's dependencies can be imported, and report what torch detects."""
    try:
        facts = attempt("libraries")
    except TrialError as reason:
        remedy = "pip install --force-reinstall --no-deps the package it names, or a new environment"
        yield Finding("learner", "error", f"cannot be imported: {reason}", remedy)
        return
    text = f"imported in {facts['seconds']:.1f} s; torch {facts['torch']} (threads: {facts['threads']})"
    yield Finding("learner", "ok", f"{text}, results are made on one thread")
    yield judge_gpu(facts["gpus"])


def judge_gpu(names: Sequence[str]) -> Finding:
    """Judge the GPUs torch can use; having none is fine."""
    if not names:
        return Finding("gpu", "ok", "none that torch can use; none is needed")
    detail = f"{', '.join(names)}: --device cuda is meant to work, but was never tested by us"
    return Finding("gpu", "ok", f"{detail}; physics runs on the CPU in any case")


def disk(scope: Scope) -> Iterator[Finding]:
    """Check the disks of the runs and the victims' weights."""
    from apil_core.policies.zoo_cache import cache_dir
    from apil_core.training.storage.run_dir import DEFAULT_ROOT

    yield free_space(
        "disk: runs", DEFAULT_ROOT.absolute(), "error", "run it in another folder, or give --out"
    )
    yield free_space(
        "disk: victims", cache_dir().absolute(), "warning", "set APIL_CACHE to a folder of yours"
    )


def free_space(check: str, folder: Path, status: Status, remedy: str) -> Finding:
    """Check the free space in ``folder``, which need not exist; ``status`` if it cannot be written."""
    place = next(above for above in (folder, *folder.parents) if above.exists())
    reason = why_unwritable(place) if place.is_dir() else f"{place} is a file"
    if reason is not None:
        return Finding(check, status, f"{folder} cannot be written: {reason}", remedy)
    free = shutil.disk_usage(place).free
    text = f"{folder}: {free / 2**30:,.1f} GiB free"
    if free < ENOUGH:
        needs = "a checkpoint takes 1 to 3 MB and a run keeps two, but metrics and videos grow"
        return Finding(check, "warning", f"{text}; {needs}", "free some space")
    return Finding(check, "ok", text)
