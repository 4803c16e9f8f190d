"""The dense reward terms the games share (docs/games.md, "Outcomes and rewards"); everything is (n,)."""

from __future__ import annotations

import numpy as np

from apil_envs.arrays import Array

CONTROL_WEIGHT = 0.1
CONTACT_WEIGHT = 0.5e-6
CONTACT_LIMIT = 10.0
SURVIVE = 5.0
FORWARD_WEIGHT = 1.25
"""Per m/s. The originals take 0.25 · Δx/0.003 s with Δx over five substeps of 0.003 s."""


def control_cost(actions: Array) -> Array:
    """0.1 Σa², from (n, a)."""
    return CONTROL_WEIGHT * np.einsum("na,na->n", actions, actions)


def contact_cost(forces: Array) -> Array:
    """min(0.5e-6 Σf², 10), from unclipped contact forces (n, k)."""
    return np.minimum(CONTACT_WEIGHT * np.einsum("nk,nk->n", forces, forces), CONTACT_LIMIT)


def survive(alive: Array) -> Array:
    """+5 where ``alive``, else −5."""
    return np.where(alive, SURVIVE, -SURVIVE)


def forward(distance: Array, seconds: float) -> Array:
    """Reward of moving ``distance`` (m) towards the goal within one control step."""
    return FORWARD_WEIGHT * distance / seconds
