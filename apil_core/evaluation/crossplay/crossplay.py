"""Every adversary against every victim."""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import nullcontext
from datetime import datetime
from pathlib import Path
from typing import Unpack

from apil_core.common.errors import ConfigError
from apil_core.evaluation.crossplay.document import CrossPlay
from apil_core.evaluation.crossplay.file import CrossPlayFile
from apil_core.evaluation.crossplay.players import Lineup, Names, SharedOptions, check_unchanged, line_up
from apil_core.evaluation.progress import PartOfAll, Progress
from apil_core.evaluation.results import EvaluationResult
from apil_core.evaluation.score import MAX_PARALLEL_GAMES, evaluate


def crossplay(
    adversaries: Names,
    victims: Names,
    *,
    episodes: int = 300,
    seed: int = 0,
    num_envs: int | None = None,
    out: Path | None = None,
    command: Sequence[str] = (),
    progress: Progress | None = None,
    **options: Unpack[SharedOptions],
) -> CrossPlay:
    """Score every adversary against every victim. All are loaded and checked before the first game.

    Args:
        adversaries, victims: runs or policy names by label, e.g.
            ``{"baseline": "zoo:kick-and-defend/defender/v1", "e_apil": "runs/a"}``.
        episodes: games of each pairing.
        seed: of the games and all draws; the same for all pairings, and the same as of :func:`evaluate`.
        num_envs: games in parallel (part of what a seed means); default 128 or ``episodes``.
        out: where the document is kept after every pairing. Pairings it has already are not played again.
        command: stored in the document.
        progress: told of the games played, over all pairings, and of each finished one.
        options: ``env``, ``physics``, ``victim_actions`` and the like for all pairings: see
            :func:`.pairing.load_pairing`. Needed where runs were trained in different games.

    Raises:
        ApilError: anything wrong with the names, files or sizes given, or ``out`` has other games.
    """
    for name, value, least in (("episodes", episodes, 1), ("seed", seed, 0)):
        if value < least:
            raise ConfigError(f"{name} must be at least {least}, got {value}")
    games = min(episodes, MAX_PARALLEL_GAMES) if num_envs is None else num_envs
    if games < 1:
        raise ConfigError(f"num_envs must be at least 1, got {games}")
    file = None if out is None else CrossPlayFile(out)
    lineup = line_up(adversaries, victims, seed=seed, num_envs=games, options=options)
    with nullcontext() if file is None else file.alone():
        document = _blank(lineup, command)
        if file is not None:
            file.take(document, lineup, episodes)
        rest = [(i, j) for i, row in enumerate(document.scores) for j, score in enumerate(row) if not score]
        progress = progress or Progress()
        for number, (i, j) in enumerate(rest):
            score = evaluate(
                list(adversaries.values())[i],
                victim=str(list(victims.values())[j]),
                episodes=episodes,
                seed=seed,
                num_envs=games,
                progress=PartOfAll(progress, number * episodes, len(rest) * episodes),
                **lineup.options,
            )
            check_unchanged(document.adversaries[i], score.adversary.sha256)
            check_unchanged(document.victims[j], score.victim.sha256)
            document.scores[i][j] = score
            if file is not None:
                document.write(file.path)
            progress.note(f"{number + 1} of {len(rest)} pairings: {_summary(document, i, j, score)}")
    return document


def _blank(lineup: Lineup, command: Sequence[str]) -> CrossPlay:
    return CrossPlay(
        env=lineup.env,
        adversaries=lineup.adversaries,
        victims=lineup.victims,
        scores=[[None] * len(lineup.victims) for _ in lineup.adversaries],
        created=datetime.fromtimestamp(time.time()).astimezone().isoformat(timespec="seconds"),
        command=list(command),
    )


def _summary(document: CrossPlay, i: int, j: int, score: EvaluationResult) -> str:
    shares = [
        f"{name} {100 * rate.value:.1f} % [{100 * rate.low:.1f}, {100 * rate.high:.1f}]"
        for name, rate in (("win", score.win_rate), ("win+tie", score.win_or_tie_rate))
    ]
    return f"{document.adversaries[i].label} against {document.victims[j].label}: {', '.join(shares)}"
