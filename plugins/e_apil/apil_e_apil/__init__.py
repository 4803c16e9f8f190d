"""E-APIL (Bui et al. 2022): APIL whose imitator is also rewarded for a low return of the adversary."""

from __future__ import annotations

from apil_core import MethodSpec, hookimpl

__all__ = ["register_methods"]

APIL_HOOK_API = 2


@hookimpl
def register_methods() -> list[MethodSpec]:
    """E-APIL: implements APIL's hook ``imitation_streams``."""
    return [
        MethodSpec(
            name="e_apil",
            factory="apil_e_apil.method:EApil",
            summary="APIL whose imitator's reward has the adversary's subtracted",
            requires=("apil",),
            config="apil_e_apil.config:EApilConfig",
            reference="Bui, Mai, Nguyen 2022, Imitating Opponent to Win",
        )
    ]
