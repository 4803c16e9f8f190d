"""Select stored results that are still valid after the matrix, a budget or a number of games changed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from apil_core.common.errors import ApilError, ConfigError
from apil_core.config.resolve import flatten
from apil_core.studies.bench.matrix import RetrainingStage

if TYPE_CHECKING:
    from apil_core.evaluation.crossplay.document import CrossPlay, Player


def same_player(one: str, other: str) -> bool:
    """Return whether two names mean the same player, even if the benchmark's directory was moved."""
    return _within(one) == _within(other)


def _within(name: str) -> str:
    for folder in ("cells", "retrained"):
        _, found, rest = name.partition(f"/{folder}/")
        if found and name.startswith(("run:", "retrained:")):
            return f"{folder}/{rest}"
    return name


def same_players(stored: Sequence[Player], now: Mapping[str, str], hashes: Mapping[str, str]) -> bool:
    """Return whether all present players are stored under the same label with the same weights.

    Args:
        stored: players of the stored result.
        now: label → name.
        hashes: SHA-256 by label, of those whose weights may have changed under the same name.
    """
    there = {player.label: player for player in stored}
    return all(
        label in there
        and same_player(there[label].name, name)
        and hashes.get(label) in (None, there[label].sha256)
        for label, name in now.items()
    )


def still_valid(
    document: CrossPlay,
    adversaries: Mapping[str, str],
    victims: Mapping[str, str],
    hashes: Mapping[str, str],
    setting: tuple[int, str | None] | None,
) -> CrossPlay:
    """Copy with the present players under their present labels, and only valid games.

    Args:
        document: played earlier.
        adversaries, victims: label → name, now.
        hashes: SHA-256 by label, of those whose weights may have changed under the same name, or ``""``.
        setting: games of a pairing, and their physics profile.
    """
    rows, columns = (
        _kept(stored, now, hashes)
        for stored, now in ((document.adversaries, adversaries), (document.victims, victims))
    )
    scores = [[document.scores[i][j] for j in columns] for i in rows]
    return document.model_copy(
        update={
            "adversaries": list(rows.values()),
            "victims": list(columns.values()),
            "scores": [
                [score if score and (score.episodes, score.physics) == setting else None for score in row]
                for row in scores
            ],
        }
    )


def _kept(stored: Sequence[Player], now: Mapping[str, str], hashes: Mapping[str, str]) -> dict[int, Player]:
    """Players that still take part, by their old index."""
    found = {}
    for place, player in enumerate(stored):
        same = [label for label, name in now.items() if same_player(name, player.name)]
        label = player.label if player.label in same else next(iter(same), None)
        if label is not None and hashes.get(label, "") in ("", player.sha256):
            found[place] = player.model_copy(update={"label": label})
    return found


def check_same_retraining(directory: Path, stage: RetrainingStage | None) -> None:
    """Check that a started retraining matches the matrix; more steps are fine.

    Raises:
        ConfigError: it was started with other settings.
    """
    from apil_core.config.kind import is_retraining
    from apil_core.runs.retraining.folder import RetrainDir

    if stage is None or not is_retraining(directory):
        return
    try:
        stored = RetrainDir(directory).config()
    except ApilError:  # its job reports the error
        return
    asked = set(RetrainingStage.model_fields) - {"steps", "games", "methods"}
    before, now = (flatten(each.model_dump(mode="json", include=asked)) for each in (stored, stage))
    for key in now:
        if before[key] != now[key]:
            raise ConfigError(
                f"{directory} was begun with {key} {before[key]!r}, the matrix says {now[key]!r}; "
                "give the changed matrix another --out"
            )
