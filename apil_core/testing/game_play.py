"""Random play of a game, recorded as a trace, for checks that compare traces."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from apil_core.api.game import Array, Game, GameStep
from apil_core.testing.checks import GAME_CHECKS, ContractError

GAMES = 6
"""Default number of games in a check."""


@dataclass
class Trial:
    """A game under test.

    Attributes:
        name: for messages.
        make: called with ``num_envs`` and ``threads``; gives fresh games.
        skipped: checks that could not be made, with reasons.
        endings: how often games of the check ended how.
    """

    name: str
    make: Callable[[int, int], Game]
    skipped: list[str] = field(default_factory=list)
    endings: dict[str, int] = field(default_factory=dict)

    def broken(self, check: str, happened: str) -> ContractError:
        """Make the error for one of :data:`GAME_CHECKS`."""
        return ContractError(f"game {self.name!r}", GAME_CHECKS[check], happened)

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
            self.trace += [o.copy() for o in self.game.observations]
            self.trace += [part.copy() for part in parts(step).values()]
            if step.done.any():
                self.game.reset(step.done)
                self.trace += [o.copy() for o in self.game.observations]
        return step


def parts(step: GameStep) -> dict[str, Array]:
    """A step's arrays by name, without ``lengths``."""
    names = ("sparse", "dense", "shaping", "done", "winner", "cause")
    return {name: getattr(step, name) for name in names}


def same(first: Play, second: Play) -> bool:
    """Return whether two traces are equal bit for bit."""
    if len(first.trace) != len(second.trace):
        return False
    pairs = zip(first.trace, second.trace, strict=True)
    return all(np.array_equal(a, b, equal_nan=a.dtype.kind == "f") for a, b in pairs)


def same_views(left: Sequence[Array], right: Sequence[Array], rows: Any = ...) -> bool:
    """Return whether both sides' observations are equal bit for bit, in those rows."""
    return all(np.array_equal(a[rows], b[rows]) for a, b in zip(left, right, strict=True))


def snapshot(game: Game) -> list[Array]:
    """Copy both observations."""
    return [o.copy() for o in game.observations]


def plain(value: Any) -> bool:
    """Return whether a state consists of arrays, numbers, strings and dicts with string keys."""
    if isinstance(value, dict):
        return all(isinstance(key, str) and plain(item) for key, item in value.items())
    return isinstance(value, np.ndarray | int | float | str)
