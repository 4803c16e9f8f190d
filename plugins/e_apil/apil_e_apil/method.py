"""E-APIL's one hook."""

from __future__ import annotations

from torch import Tensor

from apil_core import Method, Rollout, hookimpl
from apil_e_apil.config import EApilConfig


class EApil(Method):
    """The imitator maximises its own objective minus β·V_α (Bui et al. 2022; docs/methods.md §2).

    ∇V_α is itself a policy gradient with return R^α, so a reward −r̂^α, discounted like the adversary's,
    implements it; r̂^α is normalised by the standard deviation of its discounted return.
    """

    options: EApilConfig

    @hookimpl
    def imitation_streams(self, rollout: Rollout) -> dict[str, tuple[float, Tensor]] | None:
        """−r̂^α, (T, n), with weight β; nothing for β = 0, which is APIL."""
        if not self.options.beta:
            return None
        return {"adversary": (self.options.beta, -rollout.normalized_reward)}
