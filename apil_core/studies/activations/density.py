"""The density of normal play (Gleave et al. 2020): a Gaussian mixture over a victim's activations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from apil_core.common.errors import ConfigError, VictimError
from apil_core.studies.activations.options import VARIANCE

if TYPE_CHECKING:
    from sklearn.decomposition import PCA
    from sklearn.mixture import GaussianMixture

Array = NDArray[np.float64]

COMPONENTS = (1, 2, 3, 5, 8, 12, 20)
"""Numbers of components that are tried."""

FLOOR = 1e-3
"""Added to every variance, as a share of the mean one: a component may not shrink to a line or a point, where
any other activation, of normal play too, would be thousands of nats away."""


@dataclass
class Density:
    """A fitted mixture.

    Attributes:
        axes: from activations to principal components.
        mixture: over these.
        bic: by number of components, as far as tried.
        fitted: mean log-likelihood of the samples it was fitted on.
    """

    axes: PCA
    mixture: GaussianMixture
    bic: dict[int, float]
    fitted: float

    def log_likelihood(self, hidden: NDArray[np.float32]) -> Array:
        """Log density of activations (rows, k) in nats, (rows,)."""
        scores: Array = self.mixture.score_samples(self.axes.transform(hidden.astype(np.float64)))
        return scores

    def explained(self, hidden: NDArray[np.float32]) -> float:
        """Share of the squared deviation from normal play's mean that lies in the principal directions."""
        away = hidden.astype(np.float64) - self.axes.mean_
        total = float(np.square(away).sum())
        return float(np.square(away @ self.axes.components_.T).sum()) / total if total else 1.0


def check_density(components: int | None, variance: float, samples: int) -> None:
    """Check that the number of components and the variance are possible, before anything is played.

    Raises:
        ConfigError: they cannot.
    """
    if components is not None and components < 1:
        raise ConfigError(f"components must be at least 1, got {components}")
    if components is not None and components > samples:
        raise ConfigError(f"{components} components need more than {samples} samples of normal play")
    if not 0 < variance < 1:
        raise ConfigError(f"variance must be between 0 and 1, got {variance:g}")


def fit_density(
    hidden: NDArray[np.float32],
    *,
    components: int | None = None,
    candidates: Sequence[int] = COMPONENTS,
    variance: float = VARIANCE,
    seed: int = 0,
) -> Density:
    """Fit a mixture of full-covariance Gaussians to activations of normal play.

    Args:
        hidden: (rows, k), as many rows of every game.
        components: how many; default: the number of ``candidates`` with the least BIC, tried in ascending
            order until it grows.
        candidates: see there.
        variance: share of the variance to keep.
        seed: of the mixture's start.

    Raises:
        ConfigError: more components than samples.
        VictimError: the activations are always the same.
    """
    from sklearn.decomposition import PCA

    samples = hidden.astype(np.float64)
    if len(samples) < 2 or not np.ptp(samples, axis=0).any():
        raise VictimError("the victim's activations never change in normal play: they have no density")
    axes = PCA(variance, svd_solver="full").fit(samples)
    inside = axes.transform(samples)
    best: GaussianMixture | None = None
    bic: dict[int, float] = {}
    for count in sorted(candidates) if components is None else [components]:
        if best is not None and count > len(samples):
            break
        mixture = _mixture(count, seed, inside)
        bic[count] = float(mixture.bic(inside))
        if best is not None and bic[count] >= bic[best.n_components]:
            break
        best = mixture
    assert best is not None
    return Density(axes, best, bic, float(best.score(inside)))


def _mixture(count: int, seed: int, inside: Array) -> GaussianMixture:
    from sklearn.mixture import GaussianMixture

    if count > len(inside):
        raise ConfigError(f"{count} components need more than {len(inside)} samples of normal play")
    floor = FLOOR * float(inside.var(axis=0).mean())
    mixture = GaussianMixture(count, covariance_type="full", reg_covar=floor, max_iter=300, random_state=seed)
    return mixture.fit(inside)
