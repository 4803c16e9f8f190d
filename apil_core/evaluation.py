"""Scoring an adversary: win, tie and loss rates with intervals, and how the games ended."""

from __future__ import annotations

import time
from collections import Counter
from importlib import metadata
from typing import Any

from pydantic import BaseModel

from apil_core.blinding import BlindMode, make_blinding
from apil_core.config import ActionMode
from apil_core.game import Game
from apil_core.pairing import Pairing
from apil_core.play import Tally, play
from apil_core.progress import Progress
from apil_core.seeds import stream_seed

_PACKAGES = ("apil", "mujoco", "torch", "numpy")

MAX_PARALLEL_GAMES = 128
"""Slots of an evaluation unless asked otherwise. Fixed, so that a seed gives the same games anywhere."""


class Rate(BaseModel):
    """A share of games with its Wilson 95 % interval, as fractions."""

    value: float
    low: float
    high: float


class PolicyId(BaseModel):
    """Who played."""

    name: str
    sha256: str


class EvaluationResult(BaseModel):
    """A score and all it depends on. ``wins`` and the like are the adversary's."""

    env: str
    episodes: int
    wins: int
    ties: int
    losses: int
    win_rate: Rate
    tie_rate: Rate
    loss_rate: Rate
    win_or_tie_rate: Rate
    causes: dict[str, int]
    mean_length: float
    adversary: PolicyId
    victim: PolicyId
    adversary_side: str
    victim_side: str
    adversary_actions: ActionMode
    victim_actions: ActionMode
    seed: int
    num_envs: int
    blind: BlindMode | None = None
    blind_imitator: bool = False
    trained_steps: int | None = None
    game_options: dict[str, Any]
    versions: dict[str, str]
    wall_seconds: float


def wilson(count: int, total: int) -> Rate:
    """Share ``count / total`` with the Wilson score interval at 95 %."""
    from statsmodels.stats.proportion import proportion_confint

    low, high = proportion_confint(count, total, alpha=0.05, method="wilson")
    # rounding leaves 4e-18 where the interval starts at nought
    return Rate(value=count / total, low=max(float(low), 0.0) if count else 0.0, high=min(float(high), 1.0))


def score(
    pairing: Pairing,
    *,
    episodes: int,
    seed: int,
    blind: BlindMode | None = None,
    blind_imitator: bool = False,
    progress: Progress | None = None,
) -> EvaluationResult:
    """Play ``episodes`` games and summarise them.

    Uses no global randomness: a seed gives the same games at any number of threads.

    Args:
        pairing: who plays what; the game's generator is reseeded.
        episodes: number of games.
        seed: of the games and all draws.
        blind, blind_imitator: see :func:`apil_core.blinding.make_blinding`.
        progress: told of the games played.
    """
    begin = time.perf_counter()
    progress = progress or Progress()
    players = pairing.players(seed)
    if blind is not None:
        players.blinding = make_blinding(pairing, blind, imitator=blind_imitator)
    pairing.game.seed(stream_seed(seed, "evaluation games"))
    tally = play(pairing.game, players, episodes, lambda ended: progress.evaluation_progress(ended, episodes))
    return EvaluationResult(
        **_counts(tally, pairing.game, pairing.side),
        **_circumstances(pairing),
        seed=seed,
        blind=blind,
        blind_imitator=blind_imitator,
        wall_seconds=time.perf_counter() - begin,
    )


def _circumstances(pairing: Pairing) -> dict[str, Any]:
    """What a score depends on, apart from the games played."""
    config, sides = pairing.config, pairing.game.layout.sides
    adversary, victim = pairing.adversary.info, pairing.victim.info
    return {
        "env": config.env,
        "adversary": PolicyId(name=adversary.name, sha256=adversary.sha256),
        "victim": PolicyId(name=victim.name, sha256=victim.sha256),
        "adversary_side": sides[pairing.side].name,
        "victim_side": sides[1 - pairing.side].name,
        "adversary_actions": config.evaluation.adversary_actions,
        "victim_actions": config.evaluation.victim_actions,
        "num_envs": pairing.game.num_envs,
        "trained_steps": pairing.steps,
        "game_options": config.game,
        "versions": {name: metadata.version(name) for name in (*_PACKAGES, *pairing.game.packages)},
    }


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
