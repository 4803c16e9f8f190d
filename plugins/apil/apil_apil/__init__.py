"""APIL (Bui et al. 2022): APL plus a GAIL imitator whose prediction of the victim the adversary sees."""

from __future__ import annotations

from apil_core import MethodSpec, hookimpl

__all__ = ["register_methods"]

APIL_HOOK_API = 2


@hookimpl
def register_methods() -> list[MethodSpec]:
    """APIL, on top of APL; defines the hooks ``imitation_reward`` and ``imitation_streams``."""
    return [
        MethodSpec(
            name="apil",
            factory="apil_apil.method:Apil",
            summary="APL + a GAIL imitator whose predicted victim action the adversary sees",
            requires=("apl",),
            config="apil_apil.config:ApilConfig",
            hookspecs="apil_apil.hookspecs",
            reference="Bui, Mai, Nguyen 2022, Imitating Opponent to Win",
        )
    ]
