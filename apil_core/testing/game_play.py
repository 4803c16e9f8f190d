"""Random play of a game, recorded as a trace, for checks that compare traces."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from apil_core.api.game import Array, Game, GameStep
from apil_core.testing.checks import GAME_CHECKS, Subject

GAMES = 6
"""Default number of games in a check."""


@dataclass
class Trial(Subject):
    """A game under test.

    Attributes:
        make: called with ``num_envs`` and ``threads``; gives fresh games.
        endings: how often games of the check ended how.
    """

    kind = "game"
    checks = GAME_CHECKS

    make: Callable[[int, int], Game] = field(default=None)  # type: ignore[assignment]
    endings: dict[str, int] = field(default_factory=dict)

    @contextmanager
    def game(self, num_envs: int = GAMES, *, threads: int = 1, seed: int | None = 0) -> Iterator[Game]:
        """Make games, seeded and reset unless ``seed`` is ``None``; closed afterwards."""
        game = self.make(num_envs, threads)
        try:
            if seed is not None:
                game.seed(seed)
                game.reset()
            yield game
        finally:
            game.close()


class Play:
    """Plays random actions from a seed, restarts ended games, and records copies of all outputs.

    Args:
        game: to play.
        seed: of the actions.
    """

    def __init__(self, game: Game, seed: int = 0):
        self.game = game
        self.rng = np.random.default_rng(seed)
        self.trace: list[Array] = []

    def actions(self) -> tuple[Array, Array]:
        """Draw normal actions for both sides, each (n, a) float32; about a third out of bounds."""
        first, second = (
            self.rng.normal(0, side.action_limit, (self.game.num_envs, side.action_size)).astype(np.float32)
            for side in self.game.layout.sides
        )
        return first, second

    def run(self, steps: int) -> GameStep:
        """Play that many steps; return the last one's outcome."""
        for _ in range(steps):
            step = self.game.step(self.actions())
            self.trace += snapshot(self.game)
            self.trace += [part.copy() for part in parts(step).values()]
            if step.done.any():
                self.game.reset(step.done)
                self.trace += snapshot(self.game)
        return step


def parts(step: GameStep) -> dict[str, Array]:
    """A step's arrays by name, without ``lengths``."""
    names = ("sparse", "dense", "shaping", "done", "winner", "cause")
    return {name: getattr(step, name) for name in names}


def same(left: Sequence[Array], right: Sequence[Array], rows: Any = ...) -> bool:
    """Return whether traces or observations are equal bit for bit, in those rows; NaN equals NaN."""
    pairs = zip(left, right, strict=False)
    return len(left) == len(right) and all(np.array_equal(a[rows], b[rows], equal_nan=True) for a, b in pairs)


def snapshot(game: Game) -> list[Array]:
    """Copy both observations."""
    return [o.copy() for o in game.observations]


def plain(value: Any) -> bool:
    """Return whether a state consists of arrays, numbers, strings and dicts with string keys."""
    if isinstance(value, dict):
        return all(isinstance(key, str) and plain(item) for key, item in value.items())
    return isinstance(value, np.ndarray | int | float | str)
