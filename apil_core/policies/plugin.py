"""Plugin that registers the zoo and the baselines; imports neither torch nor mujoco."""

from __future__ import annotations

from apil_core.api.hooks import hookimpl
from apil_core.api.specs import PolicySpec

APIL_HOOK_API = 2


@hookimpl
def register_policies() -> list[PolicySpec]:
    """Register ``zoo:<game>/<side>/<version>``, ``baseline:<kind>/OxA`` and ``object:``."""
    return [
        PolicySpec(
            scheme="zoo",
            loader="apil_core.policies.zoo:load",
            lister="apil_core.policies.zoo:list_zoo",
            summary="pretrained agents of Bansal et al. 2018, converted on this machine",
        ),
        PolicySpec(
            scheme="baseline",
            loader="apil_core.policies.baseline:load",
            summary="agents that see nothing: random/OxA and zero/OxA (O observations, A actions)",
        ),
        PolicySpec(
            scheme="object",
            loader="apil_core.plugins.defined:load",
            summary="policy objects of this Python process, named by the functions that take them",
        ),
    ]
