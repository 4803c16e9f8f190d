"""A control that never learns: its actions stay the noise of the untrained policy."""

from __future__ import annotations

from apil_core import MethodSpec, hookimpl

__all__ = ["APIL_HOOK_API", "register_methods"]

APIL_HOOK_API = 2
"""The hook API this package was written for."""


@hookimpl
def register_methods() -> list[MethodSpec]:
    """Register it as a method, so that it can be a row of a benchmark."""
    return [
        MethodSpec(
            name="noise",
            factory="apil_noise.method:Noise",
            summary="actions are noise, nothing is learnt: what an attack must beat",
        )
    ]
