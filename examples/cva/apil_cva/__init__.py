"""CVA (Gong et al. 2022): curiosity about the victim surrogate's features, and the victim's advantage."""

from __future__ import annotations

from apil_core import MethodSpec, hookimpl

__all__ = ["APIL_HOOK_API", "register_methods"]

APIL_HOOK_API = 2
"""The hook API this package was written for."""


@hookimpl
def register_methods() -> list[MethodSpec]:
    """Register CVA: one reward stream, one mixture of advantages, one update."""
    return [
        MethodSpec(
            name="cva",
            factory="apil_cva.method:Cva",
            summary="difference of advantages plus RND curiosity on the victim's surrogate",
            config="apil_cva.config:CvaConfig",
            reference="Gong et al. 2022, Curiosity-Driven and Victim-Aware Adversarial Policies",
        )
    ]
