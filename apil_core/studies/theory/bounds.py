"""The Lemma's bound on a change of the victim's value (docs/theory.md). KL is in bits."""

from __future__ import annotations

import math

PINSKER = math.sqrt(2 * math.log(2))
"""√(2 ln 2): Σ_a |p(a) − q(a)| ≤ √(2 ln 2 · KL(p ‖ q)) with KL in bits, for either order of p and q."""


def lemma_bound(largest_value: float, largest_kl: float, gamma: float) -> float:
    """Lemma: bound on the change of the victim's value Γ when the adversary changes from π^α to π̃^α.

    Rewards depend on the state alone.

    Args:
        largest_value: H = max_s |V_ν(s)|, under either of the two adversaries.
        largest_kl: max_s KL(π^α ‖ π̃^α), bits; the other order of the two does as well.
        gamma: discount.

    Returns:
        γ H √(2 ln 2) / (1 − γ) · √KL.
    """
    return gamma * largest_value * PINSKER / (1 - gamma) * math.sqrt(largest_kl)


def informative_kl(gamma: float) -> float:
    """The KL, in bits, above which the Lemma is no tighter than 2H, which holds without it."""
    return (2 * (1 - gamma) / (gamma * PINSKER)) ** 2
