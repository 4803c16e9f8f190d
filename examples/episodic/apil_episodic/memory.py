"""Patterns of past games with the returns of those games."""

from __future__ import annotations

import torch
from torch import Tensor, nn

_BLOCK = 1024
"""Patterns per chunk of distances."""


class EpisodicMemory(nn.Module):
    """A ring of patterns (p,), each with the return of the game it occurred in.

    Args:
        capacity: patterns kept.
        size: p, length of a pattern.
    """

    patterns: Tensor
    returns: Tensor
    written: Tensor

    def __init__(self, capacity: int, size: int):
        super().__init__()
        self.register_buffer("patterns", torch.zeros(capacity, size))
        self.register_buffer("returns", torch.zeros(capacity))
        self.register_buffer("written", torch.zeros((), dtype=torch.long))

    def __len__(self) -> int:
        return min(int(self.written), len(self.returns))

    def write(self, patterns: Tensor, returns: Tensor) -> None:
        """Add patterns (m, p) with returns (m,), over the oldest; of more than fit, the last."""
        start, m, capacity = int(self.written), len(returns), len(self.returns)
        slots = torch.arange(start, start + m, device=returns.device)[-capacity:] % capacity
        self.patterns[slots], self.returns[slots] = patterns[-capacity:], returns[-capacity:]
        self.written += m

    def look_up(self, patterns: Tensor, n: int) -> Tensor:
        """Mean return of the ``n`` nearest remembered patterns, (m, p) → (m,); 0 while there are fewer."""
        if len(self) < n:
            return patterns.new_zeros(len(patterns))
        known, returns = self.patterns[: len(self)], self.returns[: len(self)]
        nearest = [
            torch.cdist(part, known).topk(n, largest=False, sorted=False).indices
            for part in patterns.split(_BLOCK)
        ]
        return returns[torch.cat(nearest)].mean(1)
