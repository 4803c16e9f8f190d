"""Scoring by name: from a run directory or a policy name to an :class:`EvaluationResult`."""

from __future__ import annotations

from pathlib import Path
from typing import Unpack

from apil_core.api.config import BlindMode
from apil_core.common.errors import ConfigError
from apil_core.common.torch_threads import one_torch_thread
from apil_core.evaluation.blinding import check_blinding
from apil_core.evaluation.pairing import PairingOptions, load_pairing
from apil_core.evaluation.progress import Progress
from apil_core.evaluation.results import EvaluationResult
from apil_core.evaluation.score import MAX_PARALLEL_GAMES, score


def evaluate(
    adversary: Path | str,
    *,
    episodes: int = 1000,
    seed: int = 0,
    num_envs: int | None = None,
    blind: BlindMode | None = None,
    blind_imitator: bool = False,
    blind_victim: BlindMode | None = None,
    progress: Progress | None = None,
    **options: Unpack[PairingOptions],
) -> EvaluationResult:
    """Score an adversary against a victim.

    Args:
        adversary: a run directory, or a policy name such as ``"zoo:kick-and-defend/defender/v1"``.
        episodes: number of games.
        seed: of the games and all draws.
        num_envs: games in parallel (part of what a seed means); default 128 or ``episodes``.
        blind: hide the opponent from the adversary: ``"zeros"``, or ``"initial"``, the mean of
            many starting states.
        blind_imitator: hide the opponent's observation and action from its methods too.
        blind_victim: hide the adversary from the victim, likewise: what then is still won was not won by
            what the victim saw of its adversary.
        progress: told of the games played.
        options: ``env``, ``victim``, ``victim_actions``, ``game_options`` and the like: see
            :func:`apil_core.evaluation.pairing.load_pairing`.

    Raises:
        ApilError: anything wrong with the names, files or sizes given.
    """
    if episodes < 1:
        raise ConfigError(f"episodes must be at least 1, got {episodes}")
    check_blinding(blind, imitator=blind_imitator)
    check_blinding(blind_victim, imitator=False)
    games = min(episodes, MAX_PARALLEL_GAMES) if num_envs is None else num_envs
    with (
        load_pairing(adversary, num_envs=games, seed=seed, **options) as pairing,
        one_torch_thread(),
        pairing.attribution(),
    ):
        return score(
            pairing,
            episodes=episodes,
            seed=seed,
            blind=blind,
            blind_imitator=blind_imitator,
            blind_victim=blind_victim,
            progress=progress,
        )
