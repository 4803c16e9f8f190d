"""Tabular policies, (S, A) with rows that sum to 1, and KL between them."""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import brentq
from scipy.special import rel_entr


def softmax(logits: np.ndarray) -> np.ndarray:
    """Policy of these logits (S, A); analytic, so that complex logits work as well."""
    weights = np.exp(logits - logits.real.max(-1, keepdims=True))
    policy: np.ndarray = weights / weights.sum(-1, keepdims=True)
    return policy


def kl_bits(old: np.ndarray, new: np.ndarray) -> np.ndarray:
    """KL(old ‖ new) in bits per state, (S,); infinite where ``old`` has an action that ``new`` lacks."""
    # rounding leaves -1e-17 between equal policies
    return np.maximum(rel_entr(old, new).sum(-1), 0.0) / math.log(2)


def random_policy(rng: np.random.Generator, states: int, actions: int, spread: float = 1.0) -> np.ndarray:
    """Dirichlet rows of that concentration, kept away from 0 so that every KL is finite."""
    policy = rng.dirichlet(np.full(actions, spread), size=states)
    return 0.999 * policy + 0.001 / actions


def at_distance(policy: np.ndarray, towards: np.ndarray, bits: np.ndarray | float) -> np.ndarray:
    """Each state's row moved towards that of ``towards`` until KL(policy ‖ result) is ``bits``,
    one number or (S,).

    Rows that do not get that far are moved all the way (to within 1e-9, so that KL stays finite).
    """

    distances = np.broadcast_to(bits, len(policy))

    def moved(row: int, share: float) -> np.ndarray:
        mixed: np.ndarray = (1 - share) * policy[row] + share * towards[row]
        return mixed

    def excess(share: float, row: int) -> float:
        return float(kl_bits(policy[row], moved(row, share)) - distances[row])

    most = 1 - 1e-9
    shares = [
        brentq(excess, 0.0, most, args=(row,), xtol=1e-14) if excess(most, row) > 0 else most
        for row in range(len(policy))
    ]
    return np.stack([moved(row, share) for row, share in enumerate(shares)])
