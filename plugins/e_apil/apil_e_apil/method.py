"""E-APIL's one hook."""

from __future__ import annotations

from collections.abc import Generator

from torch import Tensor

from apil_core import Method, Rollout, hookimpl
from apil_e_apil.config import EApilConfig


class EApil(Method):
    """The imitator maximises its own objective minus V_α (Bui et al. 2022; docs/methods.md §2).

    ∇V_α is itself a policy gradient with return R^α, so the whole change is in the reward:
    η(s, a^α, ã) = log D(s, ã) − β·r̂^α(s), r̂^α normalised by the std of its own discounted return.
    """

    options: EApilConfig

    @hookimpl(wrapper=True)
    def imitation_reward(self, rollout: Rollout) -> Generator[None, Tensor, Tensor]:
        """Subtract β·r̂^α from whatever APIL pays, shape (T, n)."""
        reward = yield
        return reward - self.options.beta * rollout.normalized_reward
