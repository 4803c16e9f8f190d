"""Scoring an adversary: win, tie and loss rates with intervals, and how the games ended."""

from __future__ import annotations

import time
from collections import Counter
from importlib import metadata
from typing import Any

import torch
from pydantic import BaseModel

from apil_core.config import ActionMode, RunConfig
from apil_core.game import Game
from apil_core.observation_filter import ObservationFilter
from apil_core.play import Seat, Tally, play
from apil_core.policy import Policy
from apil_core.progress import Progress
from apil_core.run_hooks import RunHookManager
from apil_core.seeds import stream_generator, stream_seed
from apil_core.types import Context

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
    game: Game,
    adversary: Policy,
    victim: Policy,
    *,
    config: RunConfig,
    adversary_side: int,
    episodes: int,
    seed: int,
    hooks: RunHookManager | None = None,
    trained_steps: int | None = None,
    progress: Progress | None = None,
) -> EvaluationResult:
    """Play ``episodes`` games and summarise them.

    Uses no global randomness: a seed gives the same games at any number of threads.

    Args:
        game: its generator is reseeded.
        config: gives the action modes (``config.evaluation``), the game's name and options.
        hooks: of the adversary's run; its ``filter_observation`` hooks apply here too.
    """
    begin = time.perf_counter()
    progress = progress or Progress()
    game.seed(stream_seed(seed, "evaluation games"))
    device = torch.device(config.device)
    modes = config.evaluation
    seats: dict[int, Seat] = {}
    contexts: dict[int, Context] = {}
    for side, policy, mode in (
        (adversary_side, adversary, modes.adversary_actions),
        (1 - adversary_side, victim, modes.victim_actions),
    ):
        generator = stream_generator(seed, f"evaluation seat {side}", device)
        seats[side] = Seat(policy, mode == "sample", generator)
        role = "adversary" if side == adversary_side else "victim"
        contexts[side] = Context(side, role, "eval", device, generator)  # type: ignore[arg-type]
    tally = play(
        game,
        (seats[0], seats[1]),
        episodes,
        adversary_side=adversary_side,
        device=device,
        observation_filter=ObservationFilter(hooks, contexts),
        on_progress=lambda ended: progress.evaluation_progress(ended, episodes),
    )
    counts = _counts(tally, game, adversary_side)
    return EvaluationResult(
        **counts,
        env=config.env,
        adversary=PolicyId(name=adversary.info.name, sha256=adversary.info.sha256),
        victim=PolicyId(name=victim.info.name, sha256=victim.info.sha256),
        adversary_side=game.layout.sides[adversary_side].name,
        victim_side=game.layout.sides[1 - adversary_side].name,
        adversary_actions=modes.adversary_actions,
        victim_actions=modes.victim_actions,
        seed=seed,
        num_envs=game.num_envs,
        trained_steps=trained_steps,
        game_options=config.game,
        versions={name: metadata.version(name) for name in ("apil", "mujoco", "torch", "numpy")},
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
