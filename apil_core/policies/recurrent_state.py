"""State of a recurrent network between steps: one row per game, cleared where a game starts."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

State = dict[str, Tensor]
"""Named rows of a recurrent state, each (n, width)."""


class Memory:
    """The recurrent state of one network.

    Args:
        owner: full name of the policy, for messages.
    """

    def __init__(self, owner: str):
        self.owner = owner
        self.rows: State = {}

    def begin(self, first: Tensor, initial: Callable[[int], State]) -> State:
        """The state to step from: ``initial`` rows where a game starts. Old tensors are never written into.

        Args:
            first: (n,) bool, a new game starts.
            initial: gives the state of so many new games.

        Raises:
            ValueError: the number of games changed in the middle of one.
        """
        games = len(next(iter(self.rows.values()))) if self.rows else 0
        if games != len(first):
            if not first.all():
                raise ValueError(
                    f"{self.owner}: {len(first)} games after {games}, and not all of them are new"
                )
            return initial(len(first))
        if not first.any():
            return self.rows
        fresh = initial(len(first))
        return {key: torch.where(first.unsqueeze(1), fresh[key], rows) for key, rows in self.rows.items()}

    def load(self, rows: State, device: torch.device) -> None:
        """Replace the state by copies of ``rows`` on ``device``; without rows, reset all games."""
        self.rows = {key: tensor.to(device, copy=True) for key, tensor in rows.items()}
