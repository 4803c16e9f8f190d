"""Catalogue of the zoo: every known agent, its file upstream, its SHA-256 and its sizes. Data only."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

SCHEME = "zoo"


@dataclass(frozen=True)
class GameFacts:
    """Sizes that all agents of one game share, and whether their networks are recurrent."""

    observation_size: int
    action_size: int
    recurrent: bool


GAMES: Mapping[str, GameFacts] = {
    "kick-and-defend": GameFacts(384, 17, recurrent=True),
    "you-shall-not-pass": GameFacts(380, 17, recurrent=False),
    "sumo-humans": GameFacts(395, 17, recurrent=True),
    "sumo-ants": GameFacts(137, 8, recurrent=True),
    "run-to-goal-humans": GameFacts(380, 17, recurrent=False),
    "run-to-goal-ants": GameFacts(122, 8, recurrent=False),
}

# upstream's folder and file prefix -> game and side; agent1 plays side 0
_SEATS: Mapping[str, tuple[str, str]] = {
    "kick-and-defend/kicker/agent1": ("kick-and-defend", "kicker"),
    "kick-and-defend/defender/agent2": ("kick-and-defend", "defender"),
    "you-shall-not-pass/agent1": ("you-shall-not-pass", "blocker"),
    "you-shall-not-pass/agent2": ("you-shall-not-pass", "runner"),
    "sumo/humans/agent": ("sumo-humans", "fighter"),
    "sumo/ants/agent": ("sumo-ants", "fighter"),
    "run-to-goal/humans/agent1": ("run-to-goal-humans", "runner_0"),
    "run-to-goal/humans/agent2": ("run-to-goal-humans", "runner_1"),
    "run-to-goal/ants/agent1": ("run-to-goal-ants", "runner_0"),
    "run-to-goal/ants/agent2": ("run-to-goal-ants", "runner_1"),
}

# the dot is optional: upstream has one "agent1_parameters-v1pkl"
_FILE = re.compile(r"agent-zoo/(?P<seat>.+)_parameters-(?P<version>v\d+)\.?pkl")


@dataclass(frozen=True)
class ZooEntry:
    """One agent of the zoo.

    Attributes:
        name: the part after ``zoo:``, e.g. ``"kick-and-defend/kicker/v1"``.
        game: key of :data:`GAMES`.
        file: path upstream, e.g. ``"agent-zoo/kick-and-defend/kicker/agent1_parameters-v1.pkl"``.
        sha256: of that file.
        size: of that file, in bytes.
        repository, commit: where and at which commit the two hold.
    """

    name: str
    game: str
    file: str
    sha256: str
    size: int
    repository: str
    commit: str

    @property
    def full_name(self) -> str:
        """Name with its scheme, ``"zoo:..."``."""
        return f"{SCHEME}:{self.name}"

    @property
    def facts(self) -> GameFacts:
        """Sizes of this agent's game."""
        return GAMES[self.game]

    @property
    def provenance(self) -> dict[str, str]:
        """Origin of the agent, as text."""
        return {"repository": self.repository, "commit": self.commit, "file": self.file}


@cache
def entries() -> Mapping[str, ZooEntry]:
    """Every agent upstream has, by name, sorted."""
    record = json.loads((files(__package__) / "checksums.json").read_text(encoding="utf-8"))
    rows = [_entry(record, path, sums) for path, sums in record["files"].items()]
    return {row.name: row for row in sorted(rows, key=lambda row: row.name)}


def _entry(record: dict[str, Any], path: str, sums: dict[str, Any]) -> ZooEntry:
    match = _FILE.fullmatch(path)
    assert match is not None, path
    game, side = _SEATS[match["seat"]]
    return ZooEntry(
        name=f"{game}/{side}/{match['version']}",
        game=game,
        file=path,
        sha256=sums["sha256"],
        size=sums["bytes"],
        repository=record["repository"],
        commit=record["commit"],
    )
