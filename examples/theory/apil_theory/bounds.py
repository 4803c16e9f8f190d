"""Tighter forms of the Lemma, and the bounds of the two theorems. KL is in bits; derivations: docs/theory.md.

All assume rewards that depend on the state alone. Which adversary's values H is taken over does not matter in
:func:`~apil_core.studies.theory.bounds.lemma_bound`; in its two finer forms it does.
"""

from __future__ import annotations

import math

from apil_core.studies.theory.bounds import PINSKER, lemma_bound


def lemma_bound_of_mean(largest_new_value: float, mean_kl: float, gamma: float) -> float:
    """The Lemma without its maximum over states: never above :func:`lemma_bound` for the same H.

    Args:
        largest_new_value: H = max_s |V_ν(s)| under the new adversary.
        mean_kl: KL(π^α ‖ π̃^α), bits, averaged over the old adversary's discounted visits.
        gamma: discount.
    """
    return lemma_bound(largest_new_value, mean_kl, gamma)


def lemma_bound_of_visits(largest_new_value: float, visited_root_kl: float, gamma: float) -> float:
    """The Lemma before Jensen's inequality: never above :func:`lemma_bound_of_mean`.

    Args:
        largest_new_value: H = max_s |V_ν(s)| under the new adversary.
        visited_root_kl: E[Σ_t γ^t √KL(s_t)] of games the old adversary plays, KL(π^α ‖ π̃^α) in bits. After
            a game's end there is nothing to add, so games shorter than 1 / (1 − γ) gain.
        gamma: discount.
    """
    return gamma * largest_new_value * PINSKER * visited_root_kl


def unfixed_victim_bound(largest_difference: float, epsilon: float, gamma: float) -> float:
    """Theorem (unfixed victim): |Y(ε) − Y*|, the best V_α − V_ν once the victim has changed by at most ε.

    Args:
        largest_difference: max_s |Δr(s)|.
        epsilon: largest KL between the victim that was and the one that is, over states, bits.
        gamma: discount.

    Returns:
        γ √(2 ln 2) max|Δr| / (1 − γ)² · √ε.
    """
    return lemma_bound(largest_difference / (1 - gamma), epsilon, gamma)


def imitation_constant(reward_term: float, low: float, high: float, gamma: float) -> float:
    """K = γ √(2 ln 2) (reward_term − log D^L − log(1 − D^U)) / (1 − γ)².

    Args:
        reward_term: β max_s |r^α(s)|. The printed statement has max_s r^ν(s), its proof max_s r^α(s): with
            either the theorem is false (docs/theory.md).
        low, high: D^L and D^U.
        gamma: discount.
    """
    return gamma * PINSKER * (reward_term - math.log(low) - math.log(1 - high)) / (1 - gamma) ** 2


def other_adversary_bound(constant: float, largest_kl: float) -> float:
    """Theorem (imitator under another adversary): its loss against the imitator made for that one.

    Args:
        constant: K of :func:`imitation_constant`.
        largest_kl: max_s KL between the two adversaries, bits.

    Returns:
        2 K √KL.
    """
    return 2 * constant * math.sqrt(largest_kl)
