"""Options of an analysis of activations: games to play and points to sample."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from apil_core.evaluation.options import OptionSet

VARIANCE = 0.99
"""Share of normal play's variance that the density sees.

Units of one layer share a scale, so they are not standardised, which would blow up those that hardly ever
move; but some directions hardly vary, and a full covariance over them is the covariance of noise.
"""


class Sampling(OptionSet):
    """Numbers of games and of sampled points."""

    games: Annotated[int, Field(ge=2)] = 100
    """Games against each; normal play gets as many more to fit on."""
    steps: Annotated[int, Field(ge=1)] = 100
    """Steps of each game in the likelihoods, at most."""
    points: Annotated[int, Field(ge=2)] = 500
    """Points of each opponent in the t-SNE, about."""
    perplexity: Annotated[float, Field(ge=1)] = 50.0
    """Of the t-SNE: about how many neighbours a point keeps near it; less where there are few points."""
    components: int | None = None
    """Components of the Gaussian mixture [default: by BIC]."""
    variance: float = VARIANCE
    """Share of normal play's variance that the mixture sees."""
