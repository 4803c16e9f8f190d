"""The space in which distances are measured: normalised observations of one side, projected if long."""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn

from apil_core import ObservationNormalizer


class Features(nn.Module):
    """Running normalisation and, for distances only, a fixed random projection.

    A Gaussian matrix divided by √p keeps squared distances in expectation (Johnson and Lindenstrauss 1984).

    Args:
        size: length of an observation.
        projection: p, length of the projection; 0, or at least ``size``: none.
    """

    matrix: Tensor | None

    def __init__(self, size: int, projection: int):
        super().__init__()
        self.normalizer = ObservationNormalizer(size)
        projected = 0 < projection < size
        matrix = torch.randn(size, projection) / math.sqrt(projection) if projected else None
        self.register_buffer("matrix", matrix)
        self.size = projection if projected else size

    def update(self, observations: Tensor) -> None:
        """Update the statistics with observations (T, n, o)."""
        self.normalizer.update(observations.flatten(0, 1))

    def normalize(self, observations: Tensor) -> Tensor:
        """Normalised observations, shape unchanged."""
        normalized: Tensor = self.normalizer(observations)
        return normalized

    def forward(self, observations: Tensor) -> Tensor:
        """Features between which distances are computed, (…, o) → (…, p)."""
        normalized = self.normalize(observations)
        return normalized if self.matrix is None else normalized @ self.matrix
