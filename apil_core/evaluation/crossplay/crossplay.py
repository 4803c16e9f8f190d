"""Cross-play: every adversary against every victim."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from datetime import datetime
from pathlib import Path
from typing import Any

from apil_core.common.errors import ConfigError
from apil_core.common.files import check_place, locked_for
from apil_core.evaluation.crossplay import file
from apil_core.evaluation.crossplay.document import CrossPlay
from apil_core.evaluation.crossplay.players import Participants, check_unchanged, load_all
from apil_core.evaluation.options import PairingOptions
from apil_core.evaluation.progress import PartOfAll, Progress
from apil_core.evaluation.results import EvaluationResult
from apil_core.evaluation.score import MAX_PARALLEL_GAMES, evaluate
from apil_core.plugins.defined import PolicyLike, named


def crossplay(
    adversaries: Mapping[str, PolicyLike],
    victims: Mapping[str, PolicyLike],
    options: PairingOptions | None = None,
    *,
    episodes: int = 300,
    out: Path | None = None,
    command: Sequence[str] = (),
    progress: Progress | None = None,
    **changes: Any,
) -> CrossPlay:
    """Score every adversary against every victim. All are loaded and checked before the first game.

    Args:
        adversaries, victims: runs, policies or their names by label, e.g.
            ``{"baseline": "zoo:kick-and-defend/defender/v1", "e_apil": "runs/a"}``.
        options: of all pairings: :class:`.evaluation.options.PairingOptions`. ``seed`` is the same for all
            pairings, and the same as of :func:`evaluate`; ``num_envs`` (part of what a seed means) is 128
            or ``episodes`` unless stated.
        episodes: games of each pairing.
        out: file the document is written to after every pairing. Pairings already in it are not played again.
        command: stored in the document.
        progress: called with the games played, over all pairings, and for each finished one.
        changes: single options, over ``options``. Needed where runs were trained in different games.

    Raises:
        ApilError: names, files or sizes are wrong, or ``out`` has other games.
    """
    adversaries, victims = named(adversaries), named(victims)
    if episodes < 1:
        raise ConfigError(f"episodes must be at least 1, got {episodes}")
    asked = PairingOptions.of(options, **changes)
    asked = PairingOptions.of(asked, num_envs=asked.num_envs or min(episodes, MAX_PARALLEL_GAMES))
    if out is not None:
        check_place(out)
        file.read(out)  # no document is refused before all players are loaded
    participants = load_all(adversaries, victims, asked)
    with nullcontext() if out is None else locked_for(out, "apil crossplay"):
        document = _blank(participants, command)
        if out is not None:
            file.resume_from(out, document, participants.setting, episodes)
        rest = [(i, j) for i, row in enumerate(document.scores) for j, score in enumerate(row) if not score]
        progress = progress or Progress()
        for number, (i, j) in enumerate(rest):
            score = evaluate(
                list(adversaries.values())[i],
                participants.options,
                victim=list(victims.values())[j],
                episodes=episodes,
                progress=PartOfAll(progress, number * episodes, len(rest) * episodes),
            )
            check_unchanged(document.adversaries[i], score.adversary.sha256)
            check_unchanged(document.victims[j], score.victim.sha256)
            document.scores[i][j] = score
            if out is not None:
                document.write(out)
            progress.note(f"{number + 1} of {len(rest)} pairings: {_summary(document, i, j, score)}")
    return document


def _blank(participants: Participants, command: Sequence[str]) -> CrossPlay:
    return CrossPlay(
        env=participants.setting.env,
        adversaries=participants.adversaries,
        victims=participants.victims,
        scores=[[None] * len(participants.victims) for _ in participants.adversaries],
        created=datetime.fromtimestamp(time.time()).astimezone().isoformat(timespec="seconds"),
        command=list(command),
    )


def _summary(document: CrossPlay, i: int, j: int, score: EvaluationResult) -> str:
    shares = [
        f"{name} {100 * rate.value:.1f} % [{100 * rate.low:.1f}, {100 * rate.high:.1f}]"
        for name, rate in (("win", score.win_rate), ("win+tie", score.win_or_tie_rate))
    ]
    return f"{document.adversaries[i].label} against {document.victims[j].label}: {', '.join(shares)}"
