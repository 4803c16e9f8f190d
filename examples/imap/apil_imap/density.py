"""Rarity of states: distance to the nearest of a uniform sample of states (IMAP's SC and PC)."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

_BLOCK = 1024
"""Number of states per chunk of distances."""


def neighbour_distance(states: Tensor, references: Tensor, k: int, own: Tensor | None = None) -> Tensor:
    """Mean Euclidean distance of each state to its ``k`` nearest references.

    A state does not count as its own neighbour. Where fewer than ``k`` references are left, all count.

    Args:
        states: shape (m, d).
        references: shape (r, d), r > 1 if any of them is one of ``states``.
        k: number of neighbours.
        own: shape (r,), for each reference the row of ``states`` it is, or −1; ``None``: none is.

    Returns:
        shape (m,), not negative.
    """
    k = min(k, len(references) - int(own is not None))
    result = states.new_empty(len(states))
    for start in range(0, len(states), _BLOCK):
        stop = min(start + _BLOCK, len(states))
        distances = torch.cdist(states[start:stop], references)
        if own is not None:
            here = ((own >= start) & (own < stop)).nonzero()[:, 0]
            distances[own[here] - start, here] = float("inf")
        result[start:stop] = distances.topk(k, dim=1, largest=False, sorted=False).values.mean(1)
    return result


class Reservoir:
    """Reservoir sampling: a uniform sample of all states offered; those with the smallest random keys stay.

    Args:
        size: how many states are kept.
    """

    def __init__(self, size: int):
        self.size = size
        self.states: Tensor | None = None
        self.keys: Tensor | None = None

    def offer(self, states: Tensor, generator: torch.Generator) -> Tensor:
        """Add ``states`` (m, d) to the sampled population.

        Returns:
            for each state now kept the row of ``states`` it is, or −1 if it was there before; (r,).
        """
        drawn = torch.rand(len(states), generator=generator, device=generator.device, dtype=torch.float64)
        keys, before = drawn.to(states.device), 0
        if self.states is not None and self.keys is not None:
            before = len(self.states)
            states, keys = torch.cat([self.states, states]), torch.cat([self.keys, keys])
        self.keys, kept = keys.topk(min(self.size, len(keys)), largest=False)
        self.states = states[kept]
        return torch.where(kept < before, -1, kept - before)

    def clear(self) -> None:
        """Remove all states."""
        self.states = self.keys = None

    def state_dict(self) -> dict[str, Any]:
        """Return the sample and its keys; empty before the first offer."""
        if self.states is None or self.keys is None:
            return {}
        return {"states": self.states.clone(), "keys": self.keys.clone()}

    def load_state_dict(self, state: dict[str, Any], device: torch.device) -> None:
        """Restore what :meth:`state_dict` returned."""
        self.clear()
        if state:
            self.states, self.keys = state["states"].to(device), state["keys"].to(device)
