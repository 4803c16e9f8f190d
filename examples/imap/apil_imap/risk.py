"""Distance of a state to the first one of its game (IMAP's R, as in its code)."""

from __future__ import annotations

import torch
from torch import Tensor


def openings(states: Tensor, first: Tensor, carried: Tensor | None) -> Tensor:
    """First state of each game.

    Args:
        states: shape (T, n, o).
        first: shape (T, n), bool, true where a state opens a game.
        carried: opening states (n, o) of the games under way; ``None``: their first state in ``states``.

    Returns:
        shape (T, n, o).
    """
    opening = states[0] if carried is None else carried
    result = torch.empty_like(states)
    for t in range(len(states)):
        opening = torch.where(first[t].unsqueeze(-1), states[t], opening)
        result[t] = opening
    return result


def closeness(states: Tensor, targets: Tensor) -> Tensor:
    """Minus the Euclidean distance, (…, o) × 2 → (…,)."""
    return -torch.linalg.vector_norm(states - targets, dim=-1)
