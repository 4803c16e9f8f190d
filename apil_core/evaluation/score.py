"""Scoring an adversary: win, tie and loss rates with intervals, and how the games ended."""

from __future__ import annotations

import time
from collections import Counter
from typing import Any

from apil_core.api.config import BlindMode, RunConfig
from apil_core.api.game import Game
from apil_core.common.seeds import stream_seed
from apil_core.common.torch_threads import one_torch_thread
from apil_core.evaluation.blinding import make_blinding
from apil_core.evaluation.options import EvaluationOptions, PairingOptions
from apil_core.evaluation.pairing import Pairing, load_pairing
from apil_core.evaluation.play import EpisodeCounts, play
from apil_core.evaluation.progress import Progress
from apil_core.evaluation.results import EvaluationResult, wilson
from apil_core.plugins.defined import PolicyLike
from apil_core.plugins.discovery import PluginRegistry
from apil_core.plugins.registry import make_game

MAX_PARALLEL_GAMES = 128
"""Default number of parallel games of an evaluation; fixed, so that a seed gives the same games anywhere."""


def parallel_games(config: RunConfig, episodes: int, plugins: PluginRegistry) -> Game:
    """Games of a configuration for scoring so many episodes, as many in parallel as in ``apil eval``."""
    return make_game(
        config.env,
        num_envs=min(episodes, MAX_PARALLEL_GAMES),
        threads=config.threads,
        options=config.game,
        plugins=plugins,
    )


def score(
    pairing: Pairing,
    episodes: int,
    seed: int,
    blind: BlindMode | None = None,
    blind_imitator: bool = False,
    blind_victim: BlindMode | None = None,
    progress: Progress | None = None,
) -> EvaluationResult:
    """Play ``episodes`` games and summarise them.

    Uses no global randomness: a seed gives the same games at any number of threads.

    Args:
        pairing: players and game; the game's generator is reseeded.
        episodes: number of games.
        seed: of the games and all draws.
        blind, blind_imitator, blind_victim: see :func:`apil_core.evaluate`.
        progress: called as games end.
    """
    begin = time.perf_counter()
    progress = progress or Progress()
    players = pairing.players(seed)
    side = pairing.side
    if blind is not None:
        players.blinding[side] = make_blinding(pairing, blind, side, imitator=blind_imitator)
    if blind_victim is not None:
        players.blinding[1 - side] = make_blinding(pairing, blind_victim, 1 - side)
    pairing.game.seed(stream_seed(seed, "evaluation games"))
    counts = play(
        pairing.game, players, episodes, lambda ended: progress.evaluation_progress(ended, episodes)
    )
    return EvaluationResult(
        **_rates(counts, pairing.game, pairing.side),
        **pairing.setup(seed),
        blind=blind,
        blind_imitator=blind_imitator,
        blind_victim=blind_victim,
        wall_seconds=time.perf_counter() - begin,
    )


def _rates(counts: EpisodeCounts, game: Game, adversary_side: int) -> dict[str, Any]:
    winners = Counter(counts.winners)
    wins, losses = winners[adversary_side], winners[1 - adversary_side]
    total = len(counts.winners)
    causes = Counter(counts.causes)
    return {
        "episodes": total,
        "wins": wins,
        "ties": total - wins - losses,
        "losses": losses,
        "win_rate": wilson(wins, total),
        "tie_rate": wilson(total - wins - losses, total),
        "loss_rate": wilson(losses, total),
        "win_or_tie_rate": wilson(total - losses, total),
        "causes": {name: causes[i] for i, name in enumerate(game.layout.causes) if causes[i]},
        "mean_length": sum(counts.lengths) / total,
    }


def evaluate(
    adversary: PolicyLike,
    options: PairingOptions | None = None,
    *,
    progress: Progress | None = None,
    **changes: Any,
) -> EvaluationResult:
    """Score an adversary against a victim.

    Args:
        adversary: a run directory, a policy, or its name such as ``"zoo:kick-and-defend/defender/v1"``.
        options: see :class:`.evaluation.options.EvaluationOptions`; default: none.
        progress: called as games end.
        changes: single options, over ``options``: ``episodes`` (1000), ``seed`` (0), ``env``, ``victim``,
            ``victim_actions``, ``game_options``, ``num_envs`` (part of what a seed means; default 128 or
            ``episodes``) etc. ``blind`` hides the opponent from the adversary (``"zeros"``, or
            ``"initial"``, the mean of many starting states), ``blind_imitator`` from its methods too;
            ``blind_victim`` hides the adversary from the victim: the remaining wins do not depend on the
            victim's observation of its adversary.

    Raises:
        ApilError: names, files or sizes are wrong.
    """
    asked = EvaluationOptions.of(options, **changes)
    games = asked.num_envs or min(asked.episodes, MAX_PARALLEL_GAMES)
    with (
        load_pairing(adversary, asked, num_envs=games) as pairing,
        one_torch_thread(),
        pairing.attribution(),
    ):
        return score(
            pairing,
            episodes=asked.episodes,
            seed=asked.seed,
            blind=asked.blind,
            blind_imitator=asked.blind_imitator,
            blind_victim=asked.blind_victim,
            progress=progress,
        )
