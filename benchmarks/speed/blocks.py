"""The measured blocks of one setting, and their summary."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field

from .report import LEVELS, HookCost, Level, Setting, SpeedRow, Spread

OF_A_METHOD: tuple[Level, ...] = ("collection", "training")

Key = tuple[Level, str | None]
"""Level and method; ``None`` for levels without one."""


@dataclass
class Block:
    """One level in one round.

    Attributes:
        seconds: it took.
        base: seconds that the base took for as many steps in this round, in the same games if it is physics.
    """

    seconds: float
    base: float


@dataclass
class Lap:
    """Further measurements of a method's training in a round.

    Attributes:
        seconds: of the whole iteration.
        dispatch: seconds of it between hook callers and implementations.
        calls: of hooks.
    """

    seconds: float
    dispatch: float
    calls: int


@dataclass
class Blocks:
    """All blocks of one setting.

    Attributes:
        setting: the measured one.
        levels: that are reported.
        base: level that ratios refer to.
    """

    setting: Setting
    levels: tuple[Level, ...]
    base: Level
    blocks: dict[Key, list[Block]] = field(default_factory=lambda: defaultdict(list))
    laps: dict[str, list[Lap]] = field(default_factory=lambda: defaultdict(list))
    memory: dict[Key, float] = field(default_factory=dict)

    def add(self, method: str, levels: Mapping[Level, tuple[float, float]], base: float, lap: Lap) -> None:
        """Add one more block of each level.

        Args:
            method: of the games.
            levels: seconds and peak memory by level.
            base: seconds of the base.
            lap: of the method's training.
        """
        for level, (seconds, memory_mb) in levels.items():
            key = (level, method if level in OF_A_METHOD else None)
            self.blocks[key].append(Block(seconds, base))
            self.memory[key] = max(memory_mb, self.memory.get(key, 0.0))
        self.laps[method].append(lap)

    def rows(self) -> list[SpeedRow]:
        """Rows for each level and method: the base, and the levels to report."""
        wanted = {self.base, *self.levels}
        keys = sorted((key for key in self.blocks if key[0] in wanted), key=lambda key: LEVELS.index(key[0]))
        return [self._row(key, self.blocks[key]) for key in keys]

    def hooks(self) -> list[HookCost]:
        """Hook costs, one for each method."""
        return [
            HookCost(
                **self.setting.model_dump(),
                method=method,
                calls=round(sum(lap.calls for lap in laps) / len(laps)),
                dispatch=Spread.of([lap.dispatch / lap.seconds for lap in laps]),
            )
            for method, laps in self.laps.items()
        ]

    def _row(self, key: Key, blocks: list[Block]) -> SpeedRow:
        steps = self.setting.num_envs * self.setting.num_steps
        return SpeedRow(
            **self.setting.model_dump(),
            level=key[0],
            method=key[1],
            steps_per_second=Spread.of([steps / block.seconds for block in blocks]),
            ratio=Spread.of([block.base / block.seconds for block in blocks]),
            ratio_to=self.base,
            seconds=[block.seconds for block in blocks],
            memory_mb=self.memory[key],
        )
