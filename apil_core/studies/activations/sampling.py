"""Sample the same number of steps from each game, because steps of one game are correlated."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def even_sample(game: NDArray[np.int64], each: int, seed: int) -> NDArray[np.int64]:
    """Indices of at most ``each`` rows of every game, drawn without replacement, in ascending order.

    Args:
        game: (rows,), which game a row is of.
        each: rows of a game; a shorter game gives all it has.
        seed: of the draw.
    """
    lots = np.random.default_rng(seed).random(len(game))
    order = np.lexsort((lots, game))
    _, begins, counts = np.unique(game[order], return_index=True, return_counts=True)
    rank = np.arange(len(game)) - np.repeat(begins, counts)
    return np.sort(order[rank < each])


def game_means(values: NDArray[np.float64], game: NDArray[np.int64]) -> NDArray[np.float64]:
    """Mean of ``values`` (rows,) over the rows of each game, (games,)."""
    _, index, counts = np.unique(game, return_inverse=True, return_counts=True)
    means: NDArray[np.float64] = np.bincount(index, weights=values) / counts
    return means
