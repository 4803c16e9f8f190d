"""Data of the measurements: ``speed.json`` is a :class:`SpeedReport`, with a row for each level."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal, Self, TypeVar

import numpy as np
from pydantic import BaseModel

from apil_core.common.files import write_atomically

Level = Literal["physics", "game", "victim", "collection", "training"]
"""Measured levels, each on top of the one before:

physics: the game's physics calls alone; game: with rules and observations; victim: with the victim's actions;
collection: with the adversary's actions, hooks and storage; training: with learning, a whole iteration.
"""

LEVELS: tuple[Level, ...] = ("physics", "game", "victim", "collection", "training")

CAPTIONS: dict[Level, str] = {
    "physics": "physics alone",
    "game": "+ rules, observations",
    "victim": "+ victim",
    "collection": "+ actor, hooks: collection",
    "training": "+ learning: training",
}
"""Labels of levels."""


class Spread(BaseModel):
    """Median and quartiles over blocks."""

    median: float
    low: float
    high: float

    @classmethod
    def of(cls, values: Sequence[float]) -> Self:
        """Summarise at least one value."""
        low, median, high = (float(value) for value in np.percentile(values, [25, 50, 75]))
        return cls(median=median, low=low, high=high)


class Setting(BaseModel):
    """The setting that was measured.

    Attributes:
        env: the game.
        physics: its physics profile, or ``""`` where a game has none.
        victim: full name.
        num_envs: games stepped together.
        threads: of the physics.
        num_steps: vectorised steps of one block, which are one rollout: PPO's batch is num_envs × num_steps.
    """

    env: str
    physics: str
    victim: str
    num_envs: int
    threads: int
    num_steps: int


Of = TypeVar("Of", bound=Setting)


def of_setting(entries: Sequence[Of], setting: Setting) -> list[Of]:
    """The rows of one setting."""
    names = Setting.model_fields
    return [e for e in entries if all(getattr(e, name) == getattr(setting, name) for name in names)]


class SpeedRow(Setting):
    """One level of one setting.

    Attributes:
        level: see :data:`Level`.
        method: of the training levels, else ``None``.
        steps_per_second: environment steps (of one game each) per second.
        ratio: of that rate to the base's in the same round.
        ratio_to: the base: ``physics``, or ``game`` where physics cannot be timed alone.
        seconds: of every block.
        memory_mb: largest resident set of the whole process during these blocks, 10⁶ bytes.
    """

    level: Level
    method: str | None
    steps_per_second: Spread
    ratio: Spread
    ratio_to: Level
    seconds: list[float]
    memory_mb: float


class HookCost(Setting):
    """Cost of hooks in a whole training.

    Attributes:
        method: of the training.
        calls: hook calls of an iteration.
        dispatch: share of an iteration's time between callers and implementations: pluggy, merging, checks.
    """

    method: str
    calls: int
    dispatch: Spread


class Cell(Setting):
    """Status of the measurement of one setting.

    Attributes:
        rounds: blocks of every level.
        warm_up: iterations before the first round.
        wall_seconds: all in all.
        same_games: the games of the levels ``game`` and ``victim`` ended bit for bit where those of the
            training did, so that the work was the same.
        resident_before_mb, resident_after_mb: of the process, before the setting was built and at the end.
        peak_mb: largest resident set in between.
        peak_exact: the system kept watch (Linux); else it is the largest value seen between blocks.
    """

    rounds: int
    warm_up: int
    wall_seconds: float
    same_games: bool
    resident_before_mb: float
    resident_after_mb: float
    peak_mb: float
    peak_exact: bool


class Machine(BaseModel):
    """The machine and its load."""

    cpu: str
    cpus: int
    usable_cpus: int
    platform: str
    python: str
    versions: dict[str, str]
    load_before: float
    load_after: float


class SpeedReport(BaseModel):
    """All measurements."""

    version: Literal[1] = 1
    command: list[str]
    started: str
    interrupted: bool = False
    machine: Machine
    cells: list[Cell] = []
    rows: list[SpeedRow] = []
    hooks: list[HookCost] = []

    def write(self, path: Path) -> None:
        """Write it as JSON, atomically.

        Raises:
            RunDirError: the file cannot be written.
        """
        text = self.model_dump_json(indent=2) + "\n"
        write_atomically(path, lambda file: file.write(text.encode()))
