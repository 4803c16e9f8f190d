"""Make an :class:`ActivationMap` from runs and policy names."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import datetime
from importlib import metadata
from typing import Any

from apil_core.common.extras import need
from apil_core.common.torch_threads import one_torch_thread
from apil_core.evaluation.crossplay.players import Names
from apil_core.evaluation.options import PairingOptions
from apil_core.evaluation.progress import Progress
from apil_core.evaluation.score import MAX_PARALLEL_GAMES
from apil_core.studies.activations.density import Density, check_density, fit_density
from apil_core.studies.activations.embedding import embed, usable_perplexity
from apil_core.studies.activations.intervals import gap, mean_interval
from apil_core.studies.activations.models import ActivationMap, LogLikelihood
from apil_core.studies.activations.opponents import BASELINE, gather, record_all
from apil_core.studies.activations.options import Sampling
from apil_core.studies.activations.recording import LAYER, Recorded, game_means


def analyze(
    opponents: Names,
    options: PairingOptions | None = None,
    *,
    victim: str | None = None,
    baseline: str | None = None,
    sampling: Sampling | None = None,
    command: Sequence[str] = (),
    progress: Progress | None = None,
    **changes: Any,
) -> ActivationMap:
    """Map a victim's activations against each opponent, and score them under normal play's density.

    Everything that can be wrong with the players is found before the first game. Games against each
    opponent are those of an evaluation with that seed. The result is the same at any number of threads.

    Args:
        opponents: runs or policy names by label. ``"baseline"`` is normal play, and is always included.
        options: of all games: :class:`.evaluation.options.PairingOptions`; ``num_envs`` (part of what a seed
            means) is 128 or ``sampling.games`` unless stated.
        victim: policy to analyse; default: the runs', which must be one, or the game's.
        baseline: name of the opponent of normal play; default: the game's baseline adversary.
        sampling: how much.
        command: stored in the document.
        progress: gets the number of games played, over all opponents, and notes.
        changes: single options, over ``options``.

    Raises:
        ApilError: anything wrong with names or sizes, a victim that does not tell its activations, or
            scikit-learn is missing.
    """
    need("sklearn", "matplotlib")
    sampling, progress = sampling or Sampling(), progress or Progress()
    check_density(sampling.components, sampling.variance, sampling.games * sampling.steps)
    asked = PairingOptions.of(options, **changes)
    games = asked.num_envs or min(sampling.games, MAX_PARALLEL_GAMES)
    found = gather(opponents, victim, baseline, PairingOptions.of(asked, num_envs=games))
    with _one_thread():
        recorded = record_all(found, sampling.games, progress)
        map_ = _map(recorded, sampling, asked.seed, progress)
    participants = found.participants
    return ActivationMap(
        **map_,
        env=participants.setting.env,
        victim=participants.victims[0].name,
        victim_sha256=participants.victims[0].sha256,
        layer=LAYER,
        physics=participants.setting.physics,
        opponents=list(found.names),
        players=participants.adversaries,
        seed=asked.seed,
        num_envs=games,
        versions={**participants.setting.versions, "scikit-learn": metadata.version("scikit-learn")},
        created=datetime.fromtimestamp(time.time()).astimezone().isoformat(timespec="seconds"),
        command=list(command),
    )


def _map(
    recorded: Mapping[str, Recorded], sampling: Sampling, seed: int, progress: Progress
) -> dict[str, Any]:
    """Density and t-SNE of recorded activations, as fields of :class:`ActivationMap`."""
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
    return {
        "units": fit.hidden.shape[1],
        "points": embed(drawn, perplexity, seed),
        "log_likelihood": likelihoods,
        "fitted": density.fitted,
        "games_per_opponent": sampling.games,
        "samples_per_game": sampling.steps,
        "components": density.mixture.n_components,
        "bic": density.bic,
        "variance": sampling.variance,
        "dimensions": density.axes.n_components_,
        "explained": float(density.axes.explained_variance_ratio_.sum()),
        "perplexity": perplexity,
    }


@contextmanager
def _one_thread() -> Iterator[None]:
    """Run on one thread: floating-point sums must not depend on the number of CPUs."""
    from threadpoolctl import threadpool_limits

    with one_torch_thread(), threadpool_limits(1):
        yield


def _likelihoods(
    density: Density, clouds: Mapping[str, Recorded], steps: int, seed: int
) -> list[LogLikelihood]:
    """Likelihoods for each opponent, compared with those of the first one."""
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
