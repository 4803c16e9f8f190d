"""APL (Guo et al. 2021): PPO on the difference of both players' rewards, Δr = r^α − r^ν."""

from __future__ import annotations

from apil_core import MethodSpec, hookimpl

__all__ = ["register_methods"]

APIL_HOOK_API = 2


@hookimpl
def register_methods() -> list[MethodSpec]:
    """APL: one reward term."""
    return [
        MethodSpec(
            name="apl",
            factory="apil_apl.method:Apl",
            summary="PPO on the difference of both rewards, Δr = r^α − r^ν",
            config="apil_apl.config:AplConfig",
            reference="Guo et al. 2021, Adversarial Policy Learning in Two-player Competitive Games",
        )
    ]
