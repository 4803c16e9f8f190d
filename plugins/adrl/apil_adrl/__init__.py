"""ADRL (Gleave et al. 2020): PPO on the adversary's raw reward. The baseline of all others."""

from __future__ import annotations

from apil_core import MethodSpec, hookimpl

__all__ = ["register_methods"]

APIL_HOOK_API = 2


@hookimpl
def register_methods() -> list[MethodSpec]:
    """ADRL implements no run hook: the core's PPO on r^α is the whole method."""
    return [
        MethodSpec(
            name="adrl",
            factory="apil_adrl.method:Adrl",
            summary="PPO on the raw reward r^α",
            reference="Gleave et al. 2020, Adversarial Policies: Attacking Deep Reinforcement Learning",
        )
    ]
