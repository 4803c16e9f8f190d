"""KL between a run's kept adversaries, state by state, in games they play."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
from pydantic import BaseModel

from apil_core.common.errors import ConfigError, RunDirError
from apil_core.common.statistics import mean_interval
from apil_core.common.torch_threads import one_torch_thread
from apil_core.plugins.discovery import PluginRegistry
from apil_core.plugins.registry import plugins_with
from apil_core.studies.theory.bounds import lemma_bound
from apil_core.training.storage.run_dir import RunDir

from .bounds import lemma_bound_of_visits
from .compared_games import ComparedGames, play_compared


class Estimate(BaseModel):
    """A mean over games with its 95 % interval (Student's t; of a difference Welch's)."""

    value: float
    low: float
    high: float


class PolicyChange(BaseModel):
    """Two successive kept checkpoints of a run.

    KL is KL(before ‖ after), bits, between the whole policies as they are scored: normaliser and the
    methods' observations are each policy's own. States are those the earlier one met in training's units
    of reward and with its victim's action mode.

    Attributes:
        steps_before, steps_after: of training.
        games: played by each of the two.
        states: met by the earlier one.
        kl_mean, kl_max: over these states.
        largest_value: H: the largest discounted return of the victim from any state on, by either.
        value_before, value_after: the victim's value Γ = E[Σ γ^(t+1) r^ν_t] from a game's start.
        change: after minus before.
        bound_max: the Lemma with ``kl_max`` and ``largest_value``.
        bound_visits: the same in its sharpest form, summed over the visits in these games.
    """

    steps_before: int
    steps_after: int
    games: int
    states: int
    kl_mean: float
    kl_max: float
    largest_value: float
    value_before: Estimate
    value_after: Estimate
    change: Estimate
    bound_max: float
    bound_visits: float


def policy_changes(
    run: RunDir, games: int, *, seed: int = 0, threads: int = 0, plugins: PluginRegistry | None = None
) -> list[PolicyChange]:
    """Compare each kept checkpoint with the next one.

    Args:
        run: its directory; it keeps ``checkpoint.keep`` of them.
        games: played in parallel by each adversary, at least 2.
        seed: of all games; every checkpoint starts from the same ones.
        threads: physics threads (0: all CPUs); never changes the result.
        plugins: default: installed ones and the run's one-file plugins.

    Raises:
        ApilError: fewer than two games or checkpoints, or one of these cannot be loaded.
    """
    if games < 2:
        raise ConfigError(f"games must be at least 2, got {games}")
    paths = run.checkpoints()
    if len(paths) < 2:
        raise RunDirError(
            f"{run.path} keeps {len(paths)} checkpoints, a comparison needs two: "
            "train with checkpoint.keep=2 or more"
        )
    config = run.config()
    plugins = plugins or plugins_with(config.plugins)
    followers: Sequence[Path | None] = [*paths[1:], None]
    with one_torch_thread():
        played = [
            play_compared(run, *pair, games, seed, threads, plugins)
            for pair in zip(paths, followers, strict=True)
        ]
    return [_compare(before, after) for before, after in pairwise(played)]


def _compare(before: ComparedGames, after: ComparedGames) -> PolicyChange:
    met = before.divergence[before.playing]
    largest = max(float(np.abs(games.following[games.playing]).max()) for games in (before, after))
    discounts = before.gamma ** np.arange(len(before.playing))
    roots = np.where(before.playing, np.sqrt(before.divergence), 0.0)
    return PolicyChange(
        steps_before=before.steps,
        steps_after=after.steps,
        games=before.playing.shape[1],
        states=len(met),
        kl_mean=float(met.mean()),
        kl_max=float(met.max()),
        largest_value=largest,
        value_before=_mean(before.values),
        value_after=_mean(after.values),
        change=_difference(after.values, before.values),
        bound_max=lemma_bound(largest, float(met.max()), before.gamma),
        bound_visits=lemma_bound_of_visits(largest, float((discounts @ roots).mean()), before.gamma),
    )


def _mean(values: np.ndarray) -> Estimate:
    return _estimate(float(values.mean()), mean_interval(values))


def _difference(new: np.ndarray, old: np.ndarray) -> Estimate:
    from scipy.stats import ttest_ind

    interval = ttest_ind(new, old, equal_var=False).confidence_interval()
    return _estimate(float(new.mean() - old.mean()), (interval.low, interval.high))


def _estimate(value: float, interval: tuple[float, float]) -> Estimate:
    # games that all give the same leave no spread to divide by
    low, high = (float(end) if math.isfinite(end) else value for end in interval)
    return Estimate(value=value, low=low, high=high)
