"""The attack that never learns: its actions stay the noise of the untrained policy."""

from __future__ import annotations

from apil_core import MethodSpec, hookimpl

__all__ = ["APIL_HOOK_API", "register_methods"]

APIL_HOOK_API = 2
"""The hook API this package was written for."""


@hookimpl
def register_methods() -> list[MethodSpec]:
    """A method like any other, so that it is a row of a benchmark."""
    return [
        MethodSpec(
            name="noise",
            factory="apil_noise.method:Noise",
            summary="actions are noise, nothing is learnt: what an attack must beat",
        )
    ]
