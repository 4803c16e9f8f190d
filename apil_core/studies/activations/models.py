"""Data models of an analysis of activations."""

from __future__ import annotations

from typing import Self

from pydantic import BaseModel, model_validator

from apil_core.common.documents import JsonDocument
from apil_core.evaluation.crossplay.document import Player


class Gap(BaseModel):
    """A difference of mean log-likelihoods in nats, with its 95 % interval (bootstrap over games)."""

    value: float
    low: float
    high: float

    @property
    def within_noise(self) -> bool:
        """Return whether 0 lies in the interval."""
        return self.low <= 0 <= self.high


class LogLikelihood(BaseModel):
    """Log-likelihood of activations under the density of normal play, in nats per activation vector.

    Attributes:
        mean: over games of the mean over a game's sampled steps.
        low, high: 95 % interval of it, bootstrap over games.
        n: games.
        explained: share of these activations' deviation from normal play's mean that lies in the directions
            the density sees; the rest of it counts for nothing.
        to_baseline: this mean minus the baseline's, or ``None`` for the baseline itself.
    """

    mean: float
    low: float
    high: float
    n: int
    explained: float
    to_baseline: Gap | None = None


class ActivationMap(JsonDocument):
    """A victim's activations against each opponent.

    Attributes:
        victim, victim_sha256: name and hash of the analysed policy.
        layer, units: which ones, and how many.
        physics: profile of the games, ``None`` for a game without.
        opponents: labels; the first one is normal play, on games that the density was not fitted on.
        players: their names and hashes.
        points: for each opponent (x, y) of the t-SNE, which has no units.
        log_likelihood: for each opponent.
        fitted: log-likelihood of the samples that the density was fitted on; where it is much higher than
            that of the held-out ones, there were too few games.
        games_per_opponent: games of each opponent, and as many more of normal play to fit on.
        samples_per_game: steps of a game in the likelihoods, at most.
        components: of the mixture.
        bic: Bayesian information criterion by number of components, as far as tried.
        variance, dimensions: requested share of normal play's variance, and how many principal
            directions give it.
        explained: share of it that they have.
        perplexity, seed, num_envs: of the t-SNE; of everything drawn; games in parallel.
    """

    maker = "apil analyze activations"

    env: str
    victim: str
    victim_sha256: str
    layer: str
    units: int
    physics: str | None = None
    opponents: list[str]
    players: list[Player]
    points: list[list[tuple[float, float]]]
    log_likelihood: list[LogLikelihood]
    fitted: float
    games_per_opponent: int
    samples_per_game: int
    components: int
    bic: dict[int, float]
    variance: float
    dimensions: int
    explained: float
    perplexity: float
    seed: int
    num_envs: int
    versions: dict[str, str]

    @model_validator(mode="after")
    def _one_each(self) -> Self:
        lengths = {len(part) for part in (self.opponents, self.players, self.points, self.log_likelihood)}
        if len(lengths) > 1:
            raise ValueError("opponents, players, points and log_likelihood must be of one length")
        return self
