"""A white-box attack: paid where the victim's action depends on what it sees of its opponent."""

from __future__ import annotations

from apil_core import MethodSpec, hookimpl

__all__ = ["APIL_HOOK_API", "register_methods"]

APIL_HOOK_API = 2
"""The hook API this package was written for."""


@hookimpl
def register_methods() -> list[MethodSpec]:
    """Register it as a white-box method."""
    return [
        MethodSpec(
            name="saliency",
            factory="apil_saliency.method:Saliency",
            summary="PPO on the reward plus the victim's sensitivity to its opponent (white box)",
            config="apil_saliency.config:SaliencyConfig",
            white_box=True,
        )
    ]
