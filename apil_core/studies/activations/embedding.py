"""t-SNE of all opponents' activations together."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Points = list[tuple[float, float]]


def usable_perplexity(perplexity: float, points: int) -> float:
    """``perplexity``, or the largest that so few points allow."""
    return min(perplexity, (points - 1) / 3)


def embed(clouds: Sequence[NDArray[np.float32]], perplexity: float, seed: int) -> list[Points]:
    """Coordinates for each cloud's rows, in one map.

    Args:
        clouds: (rows, k) each.
        perplexity: about how many neighbours a point keeps near it.
        seed: of everything drawn.
    """
    from sklearn.manifold import TSNE

    pooled = np.concatenate(clouds).astype(np.float64)
    tsne = TSNE(2, perplexity=perplexity, init=_start(pooled), random_state=seed, n_jobs=1)
    found = tsne.fit_transform(pooled)
    parts = np.split(found, np.cumsum([len(cloud) for cloud in clouds])[:-1])
    return [[(round(float(x), 3), round(float(y), 3)) for x, y in part] for part in parts]


def _start(pooled: NDArray[np.float64]) -> str:
    """Initial coordinates from the two largest principal components, where there are two."""
    return "pca" if min(pooled.shape) >= 2 and np.ptp(pooled, axis=0).any() else "random"
