"""E-APIL's options."""

from __future__ import annotations

from apil_core import Section


class EApilConfig(Section):
    """Weight of the adversary's reward in the imitator's."""

    beta: float = 1.0
    """β, the weight of −V_α: of normalised advantages, or (credit: return) η = log D(s, ã) − β·r̂^α."""
