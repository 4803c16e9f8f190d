"""IMAP (Zheng et al. 2024): an adversary with an intrinsic reward, weighted less as it stops improving."""

from __future__ import annotations

from apil_core import MethodSpec, hookimpl

__all__ = ["APIL_HOOK_API", "register_methods"]

APIL_HOOK_API = 2
"""Version of APIL's hooks this package is written for."""


@hookimpl
def register_methods() -> list[MethodSpec]:
    """Register IMAP on its own: the game's reward and one intrinsic stream."""
    return [
        MethodSpec(
            name="imap",
            factory="apil_imap.method:Imap",
            summary="PPO on the reward plus an intrinsic bonus: coverage, risk or divergence",
            config="apil_imap.config:ImapConfig",
            reference="Zheng et al. 2024, Toward Evaluating Robustness of RL with Adversarial Policy",
        )
    ]
