"""From runs and policy names to an :class:`ActivationMap`."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime
from importlib import metadata
from typing import Unpack

from apil_core.common.errors import ConfigError
from apil_core.common.extras import need
from apil_core.common.torch_threads import one_torch_thread
from apil_core.evaluation.crossplay.players import Names, SharedOptions
from apil_core.evaluation.progress import Progress
from apil_core.evaluation.score import MAX_PARALLEL_GAMES
from apil_core.studies.activations.density import VARIANCE, Density, check_density, fit_density
from apil_core.studies.activations.embedding import PERPLEXITY, embed, usable_perplexity
from apil_core.studies.activations.intervals import gap, mean_interval
from apil_core.studies.activations.models import ActivationMap, LogLikelihood
from apil_core.studies.activations.opponents import BASELINE, gather, record_all
from apil_core.studies.activations.recording import LAYER, Recorded
from apil_core.studies.activations.sampling import game_means


@dataclass(frozen=True)
class Sampling:
    """How much is played and looked at.

    Attributes:
        games: against each opponent; normal play gets as many more, which the density is fitted on.
        steps: of each game in the likelihoods, at most.
        points: of each opponent in the t-SNE, about.
        perplexity: of the t-SNE; less where there are few points.
        components: of the mixture; ``None``: by BIC.
        variance: share of normal play's variance that the density sees.
    """

    games: int = 100
    steps: int = 100
    points: int = 500
    perplexity: float = PERPLEXITY
    components: int | None = None
    variance: float = VARIANCE

    def check(self) -> None:
        """Whether these numbers make sense.

        Raises:
            ConfigError: they do not.
        """
        least = {"games": 2, "steps": 1, "points": 2}
        for name, low in least.items():
            if getattr(self, name) < low:
                raise ConfigError(f"{name} must be at least {low}, got {getattr(self, name)}")
        if not self.perplexity >= 1:  # nor NaN
            raise ConfigError(f"perplexity must be at least 1, got {self.perplexity:g}")
        check_density(self.components, self.variance, self.games * self.steps)


def analyze(
    opponents: Names,
    *,
    victim: str | None = None,
    baseline: str | None = None,
    sampling: Sampling = Sampling(),
    seed: int = 0,
    num_envs: int | None = None,
    command: Sequence[str] = (),
    progress: Progress | None = None,
    **options: Unpack[SharedOptions],
) -> ActivationMap:
    """Look at what a victim's units do against each opponent, and how usual that is.

    Everything that can be wrong with the players is found before the first game. Games against each
    opponent are those of an evaluation with that seed.

    Args:
        opponents: runs or policy names by label. ``"baseline"`` is normal play, and is there anyway.
        victim: whose activations; default: the runs', which must be one, or the game's.
        baseline: name of the opponent of normal play; default: the game's baseline adversary.
        sampling: how much.
        seed: of the games and everything drawn. The result is the same at any number of threads.
        num_envs: games in parallel (part of what a seed means); default 128 or ``sampling.games``.
        command: stored in the document.
        progress: told of the games played, over all opponents, and of what is done.
        options: ``env``, ``physics`` and the like for all games: see
            :func:`apil_core.evaluation.pairing.load_pairing`.

    Raises:
        ApilError: anything wrong with names or sizes, a victim that does not tell its activations, or
            scikit-learn is missing.
    """
    need("sklearn", "matplotlib")
    sampling.check()
    games = min(sampling.games, MAX_PARALLEL_GAMES) if num_envs is None else num_envs
    for name, value, least in (("num_envs", games, 1), ("seed", seed, 0)):
        if value < least:
            raise ConfigError(f"{name} must be at least {least}, got {value}")
    progress = progress or Progress()
    found = gather(opponents, victim, baseline, seed=seed, num_envs=games, options=options)
    with _one_thread():
        recorded = record_all(found, sampling.games, seed, progress)
        fit, held_out = recorded[BASELINE].split(sampling.games)
        progress.note("fitting the density of normal play")
        density = fit_density(
            fit.sample(sampling.steps, seed).hidden,
            components=sampling.components,
            variance=sampling.variance,
            seed=seed,
        )
        clouds = {**recorded, BASELINE: held_out}
        likelihoods = _likelihoods(density, clouds, sampling.steps, seed)
        progress.note(f"t-SNE of about {sampling.points * len(clouds):,} points")
        each = max(1, round(sampling.points / sampling.games))
        drawn = [cloud.sample(each, seed + 1).hidden for cloud in clouds.values()]
        perplexity = usable_perplexity(sampling.perplexity, sum(map(len, drawn)))
        points = embed(drawn, perplexity, seed)
    lineup = found.lineup
    return ActivationMap(
        env=lineup.env,
        victim=lineup.victims[0].name,
        victim_sha256=lineup.victims[0].sha256,
        layer=LAYER,
        units=fit.hidden.shape[1],
        physics=lineup.setting.physics,
        opponents=list(found.names),
        players=lineup.adversaries,
        points=points,
        log_likelihood=likelihoods,
        fitted=density.fitted,
        games_per_opponent=sampling.games,
        samples_per_game=sampling.steps,
        components=density.mixture.n_components,
        bic=density.bic,
        variance=sampling.variance,
        dimensions=density.axes.n_components_,
        explained=float(density.axes.explained_variance_ratio_.sum()),
        perplexity=perplexity,
        seed=seed,
        num_envs=games,
        versions={**lineup.setting.versions, "scikit-learn": metadata.version("scikit-learn")},
        created=datetime.fromtimestamp(time.time()).astimezone().isoformat(timespec="seconds"),
        command=list(command),
    )


@contextmanager
def _one_thread() -> Iterator[None]:
    """Sums, and what follows from them, must not depend on the number of CPUs."""
    from threadpoolctl import threadpool_limits

    with one_torch_thread(), threadpool_limits(1):
        yield


def _likelihoods(
    density: Density, clouds: Mapping[str, Recorded], steps: int, seed: int
) -> list[LogLikelihood]:
    """For each opponent; the first one is what the others are compared with."""
    found: list[LogLikelihood] = []
    base = None
    for cloud in clouds.values():
        drawn = cloud.sample(steps, seed)
        games = game_means(density.log_likelihood(drawn.hidden), drawn.game)
        low, high = mean_interval(games, seed)
        found.append(
            LogLikelihood(
                mean=float(games.mean()),
                low=low,
                high=high,
                n=len(games),
                explained=density.explained(drawn.hidden),
                to_baseline=None if base is None else gap(games, base, seed),
            )
        )
        base = games if base is None else base
    return found
