"""Reward revision from an episodic memory, after the idea of Chen et al. 2025."""

from __future__ import annotations

from apil_core import MethodSpec, hookimpl

__all__ = ["APIL_HOOK_API", "register_methods"]

APIL_HOOK_API = 2
"""The hook API this package was written for."""


@hookimpl
def register_methods() -> list[MethodSpec]:
    """Register it as a method: PPO on the revised reward."""
    return [
        MethodSpec(
            name="episodic",
            factory="apil_episodic.method:Episodic",
            summary="PPO on the reward revised by the returns of similar past games",
            config="apil_episodic.config:EpisodicConfig",
            reference="after Chen et al. 2025, Episodic Reward Engineering (TMLR)",
        )
    ]
