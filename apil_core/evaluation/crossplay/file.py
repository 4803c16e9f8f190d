"""The document of cross-play on disk: written with every pairing, and continued."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from apil_core.common.errors import ConfigError
from apil_core.evaluation.crossplay.document import CrossPlay
from apil_core.evaluation.crossplay.players import settings
from apil_core.evaluation.results import MatchSetup


def read(path: Path) -> CrossPlay | None:
    """The document in a file; ``None`` before the first pairing.

    Raises:
        ConfigError: it is no cross-play document.
    """
    return CrossPlay.read(path) if path.exists() else None


def resume_from(path: Path, into: CrossPlay, setting: MatchSetup, episodes: int) -> None:
    """Fill ``into`` with the pairings that are in the file.

    Raises:
        ConfigError: one of them was played with other settings than requested now, or by a player that
            is not requested now.
    """
    stored = read(path)
    if stored is None:
        return
    _check(path, stored.env, into.env, "the games are of ")
    sides = (("adversary", stored.adversaries, into.adversaries), ("victim", stored.victims, into.victims))
    for side, then, now in sides:
        here = {player.label: player.sha256 for player in now}
        for player in then:
            if player.label not in here:
                raise ConfigError(
                    f"{path} holds games of {side} {player.label}, whom this call does not name: name "
                    "all players it has (and any others), or take another --out file"
                )
            _check(path, player.sha256, here[player.label], f"{side} {player.label} was SHA-256 ")
    expected = settings(setting, episodes)
    for i, adversary in enumerate(into.adversaries):
        for j, victim in enumerate(into.victims):
            score = into.scores[i][j] = stored.score(adversary.label, victim.label)
            for key, value in settings(score, score.episodes).items() if score else ():
                _check(path, value, expected.get(key), f"games were played with {key} ")
    into.created = stored.created


def _check(path: Path, then: Any, now: Any, what: str) -> None:
    if then != now:
        raise ConfigError(
            f"{path}: {what}{then}, this call has {now}: take another --out file, or the "
            "same players and settings"
        )
