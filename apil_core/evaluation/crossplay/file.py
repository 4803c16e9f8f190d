"""The document of cross-play on disk: written with every pairing, and continued."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from apil_core.common.errors import ConfigError
from apil_core.common.files import check_place, locked
from apil_core.evaluation.crossplay.document import CrossPlay, Player
from apil_core.evaluation.crossplay.players import settings
from apil_core.evaluation.results import EvaluationResult, MatchSetup


class CrossPlayFile:
    """One JSON document, rewritten atomically with every pairing.

    Args:
        path: created with the first pairing if it is not there.

    Raises:
        ConfigError: the file is not writable, or is no cross-play document.
    """

    def __init__(self, path: Path):
        self.path = path
        check_place(path)
        self._read()

    @contextmanager
    def lock(self) -> Iterator[None]:
        """Lock the file against other processes.

        Raises:
            ConfigError: another process holds the lock.
        """
        with locked(
            self.path.with_name(f".{self.path.name}.lock"),
            f"{self.path}: another apil crossplay is writing to it",
            ConfigError,
        ):
            yield

    def resume_from(self, into: CrossPlay, setting: MatchSetup, episodes: int) -> None:
        """Fill ``into`` with the pairings that are in the file.

        Raises:
            ConfigError: one of them was played with other settings than requested now, or by a player that
                is not requested now.
        """
        stored = self._read()
        if stored is None:
            return
        self._check(stored.env, into.env, "the games are of", "")
        for then, now, side in (
            (stored.adversaries, into.adversaries, "adversary"),
            (stored.victims, into.victims, "victim"),
        ):
            self._check_players(then, now, side)
        expected = settings(setting, episodes)
        for i, adversary in enumerate(into.adversaries):
            for j, victim in enumerate(into.victims):
                score = stored.score(adversary.label, victim.label)
                if score is not None:
                    self._check_settings(score, expected)
                    into.scores[i][j] = score
        into.created = stored.created

    def _read(self) -> CrossPlay | None:
        return CrossPlay.read(self.path) if self.path.exists() else None

    def _check_players(self, then: Sequence[Player], now: Sequence[Player], side: str) -> None:
        here = {player.label: player for player in now}
        for player in then:
            if player.label not in here:
                raise ConfigError(
                    f"{self.path} holds games of {side} {player.label}, whom this call does not name: name "
                    "all players it has (and any others), or take another --out file"
                )
            self._check(player.sha256, here[player.label].sha256, f"{side} {player.label} was", "SHA-256 ")

    def _check_settings(self, score: EvaluationResult, expected: dict[str, Any]) -> None:
        for key, then in settings(score, score.episodes).items():
            self._check(then, expected.get(key), "games were played with", f"{key} ")

    def _check(self, then: Any, now: Any, what: str, unit: str) -> None:
        if then != now:
            raise ConfigError(
                f"{self.path}: {what} {unit}{then}, this call has {now}: take another --out file, or the "
                "same players and settings"
            )
