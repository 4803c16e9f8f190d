"""Public interface of the zoo: list, load, import, download. Imports torch only in ``load``."""

from __future__ import annotations

from typing import TYPE_CHECKING

from apil_core.api.specs import PolicyListing
from apil_core.common.errors import UnknownNameError
from apil_core.policies import zoo_cache as cache
from apil_core.policies import zoo_catalogue as catalogue
from apil_core.policies.zoo_download import download_zoo
from apil_core.policies.zoo_import import ImportRow, ZooImportError, import_zoo

if TYPE_CHECKING:
    from apil_core.policies.zoo_policy import ZooPolicy

__all__ = ["ImportRow", "ZooImportError", "download_zoo", "import_zoo", "list_zoo", "load"]


def list_zoo() -> list[PolicyListing]:
    """Every agent upstream has; ``available`` where the cache holds it (``load`` checks its content)."""
    return [
        PolicyListing(
            name=entry.full_name,
            available=cache.cached_file(entry).is_file(),
            sha256=entry.sha256,
            provenance=f"{entry.repository}@{entry.commit[:12]}:{entry.file}",
        )
        for entry in catalogue.entries().values()
    ]


def load(name: str) -> ZooPolicy:
    """A fresh policy on the CPU.

    Args:
        name: without the scheme, e.g. ``"kick-and-defend/kicker/v1"``.

    Raises:
        UnknownNameError: the zoo has no such agent.
        VictimError: it is not in the cache, or its file there is damaged.
    """
    from apil_core.api.policy import PolicyInfo
    from apil_core.policies.zoo_policy import ZooPolicy

    known = catalogue.entries()
    if name not in known:
        names = (entry.full_name for entry in known.values())
        raise UnknownNameError("victim", f"{catalogue.SCHEME}:{name}", names)
    entry = known[name]
    facts = entry.facts
    info = PolicyInfo(
        name=entry.full_name,
        sha256=entry.sha256,
        observation_size=facts.observation_size,
        action_size=facts.action_size,
        provenance=entry.provenance,
    )
    return ZooPolicy(info, cache.read(entry))
