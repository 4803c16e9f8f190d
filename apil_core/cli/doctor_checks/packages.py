"""What is installed, against what the distribution itself asks for."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from importlib import metadata

from packaging.requirements import Requirement

from apil_core.cli.doctor_checks.finding import Finding, error, good, listed
from apil_core.cli.doctor_checks.interpreter import DISTRIBUTION
from apil_core.cli.doctor_checks.scope import Scope

_FIRST = ("torch", "mujoco", "numpy", "rsl-rl-lib")
"""What a score may depend on most, named first."""


@dataclass(frozen=True)
class Package:
    """A requirement, and what is here of it.

    Attributes:
        requirement: name and versions asked for.
        found: the installed version, or ``None``.
    """

    requirement: Requirement
    found: str | None

    @property
    def fits(self) -> bool:
        """Whether it is here in a version asked for."""
        return self.found is not None and self.requirement.specifier.contains(self.found, prereleases=True)

    @property
    def asked(self) -> str:
        """As pip takes it, e.g. ``"numpy>=2.0"``."""
        return f"{self.requirement.name}{self.requirement.specifier}"


def check(scope: Scope) -> Iterator[Finding]:
    """All required packages in one line, each wrong one in its own, and a line for each extra."""
    try:
        distribution = metadata.distribution(DISTRIBUTION)
    except metadata.PackageNotFoundError:
        yield error("packages", f"{DISTRIBUTION} is not installed in this Python", "pip install -e .")
        return
    requirements = distribution.requires or []
    extras = distribution.metadata.get_all("Provides-Extra") or []
    yield from _required(packages_of(requirements))
    for extra in extras:
        yield _optional(extra, packages_of(requirements, extra))


def packages_of(requirements: Iterable[str], extra: str = "") -> list[Package]:
    """The packages that ``requirements`` ask for on this machine: without extras, or by ``extra`` alone."""
    parsed = [Requirement(text) for text in requirements]
    chosen = [one for one in parsed if _applies(one, extra) and not (extra and _applies(one, ""))]
    order = {name: place for place, name in enumerate(_FIRST)}
    chosen.sort(key=lambda one: (order.get(one.name, len(order)), one.name))
    return [Package(one, _version(one.name)) for one in chosen]


def _applies(requirement: Requirement, extra: str) -> bool:
    return requirement.marker is None or requirement.marker.evaluate({"extra": extra})


def _version(name: str) -> str | None:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None


def _required(packages: list[Package]) -> Iterator[Finding]:
    fitting = [package for package in packages if package.fits]
    versions = listed(f"{package.requirement.name} {package.found}" for package in fitting)
    yield good("packages", f"{len(fitting)} of {len(packages)} as required: {versions}")
    for package in packages:
        if not package.fits:
            here = f"is {package.found} here" if package.found else "is not installed"
            detail = f"{package.requirement.name} {here}, {package.asked} is needed"
            yield error("packages", detail, f"pip install -c constraints.txt '{package.asked}'")


def _optional(extra: str, packages: list[Package]) -> Finding:
    check, missing = f"extra: {extra}", [package.asked for package in packages if not package.fits]
    if not missing:
        versions = listed(f"{package.requirement.name} {package.found}" for package in packages)
        return good(check, f"here: {versions}")
    remedy = f"pip install -c constraints.txt -e '.[{extra}]'"
    return good(check, f"not here (optional), misses {listed(missing)}", remedy)
