"""Scoring an adversary: win, tie and loss rates with intervals, and how the games ended."""

from __future__ import annotations

import time
from collections import Counter
from typing import Any

from apil_core.api.config import BlindMode
from apil_core.api.game import Game
from apil_core.common.seeds import stream_seed
from apil_core.evaluation.blinding import make_blinding
from apil_core.evaluation.pairing import Pairing, circumstances
from apil_core.evaluation.play import Tally, play
from apil_core.evaluation.progress import Progress
from apil_core.evaluation.results import EvaluationResult, wilson

MAX_PARALLEL_GAMES = 128
"""Slots of an evaluation unless asked otherwise. Fixed, so that a seed gives the same games anywhere."""


def score(
    pairing: Pairing,
    *,
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
        pairing: who plays what; the game's generator is reseeded.
        episodes: number of games.
        seed: of the games and all draws.
        blind, blind_imitator, blind_victim: see :func:`apil_core.evaluate`.
        progress: told of the games played.
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
    tally = play(pairing.game, players, episodes, lambda ended: progress.evaluation_progress(ended, episodes))
    return EvaluationResult(
        **_counts(tally, pairing.game, pairing.side),
        **circumstances(pairing, seed),
        blind=blind,
        blind_imitator=blind_imitator,
        blind_victim=blind_victim,
        wall_seconds=time.perf_counter() - begin,
    )


def _counts(tally: Tally, game: Game, adversary_side: int) -> dict[str, Any]:
    winners = Counter(tally.winners)
    wins, losses = winners[adversary_side], winners[1 - adversary_side]
    total = len(tally.winners)
    causes = Counter(tally.causes)
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
        "mean_length": sum(tally.lengths) / total,
    }
