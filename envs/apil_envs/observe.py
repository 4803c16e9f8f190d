"""Observations, assembled block by block straight from the simulations into two buffers in turn.

A :class:`Block` writes its columns for all games at once, or for a few after a reset; nothing here
runs per game and nothing is copied twice.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from apil_envs.arrays import ALL, Array, Rows


@dataclass(frozen=True)
class Block:
    """Named columns of an observation.

    Attributes:
        name: unique within the observation.
        size: number of columns.
        fill: called as ``fill(rows, out)``; writes the block of these games into ``out``
            (len(rows), size), float32.
        about_opponent: columns of the block, counted from its start, that depend on the opponent.
    """

    name: str
    size: int
    fill: Callable[[Rows, Array], None]
    about_opponent: tuple[int, ...] = ()


def copied(name: str, source: Array, about_opponent: bool = False) -> Block:
    """``source`` (n, k) unchanged."""

    def fill(rows: Rows, out: Array) -> None:
        out[...] = source[rows]

    columns = tuple(range(source.shape[1])) if about_opponent else ()
    return Block(name, source.shape[1], fill, columns)


def clipped(name: str, source: Array, bound: float) -> Block:
    """``source`` (n, k) clipped to ±bound."""

    def fill(rows: Rows, out: Array) -> None:
        np.clip(source[rows], -bound, bound, out=out, casting="same_kind")

    return Block(name, source.shape[1], fill)


def relative(name: str, source: Array, origin: Array, about_opponent: bool = False) -> Block:
    """``source - origin``, both (n, k)."""

    def fill(rows: Rows, out: Array) -> None:
        np.subtract(source[rows], origin[rows], out=out, casting="same_kind")

    columns = tuple(range(source.shape[1])) if about_opponent else ()
    return Block(name, source.shape[1], fill, columns)


def distance_to(name: str, targets: Sequence[float], source: Array) -> Block:
    """``targets - source``: one column per column of ``source`` (n, k)."""
    where = np.asarray(targets, float)

    def fill(rows: Rows, out: Array) -> None:
        np.subtract(where, source[rows], out=out, casting="same_kind")

    return Block(name, source.shape[1], fill)


def computed(name: str, value: Callable[[Rows], Array], about_opponent: bool = False) -> Block:
    """One column: ``value(rows)``, (len(rows),)."""

    def fill(rows: Rows, out: Array) -> None:
        out[:, 0] = value(rows)

    return Block(name, 1, fill, (0,) if about_opponent else ())


class Observer:
    """One side's observations: two float32 buffers, written in turn.

    Attributes:
        size: columns.
        blocks: name to columns, in order, without gaps.
        opponent_channels: columns that depend on the opponent.
    """

    def __init__(self, blocks: Sequence[Block], num_envs: int):
        self._parts: list[tuple[Block, slice]] = []
        self.size = 0
        channels: list[int] = []
        for block in blocks:
            self._parts.append((block, slice(self.size, self.size + block.size)))
            channels += [self.size + column for column in block.about_opponent]
            self.size += block.size
        self.blocks = {block.name: columns for block, columns in self._parts}
        self.opponent_channels = tuple(channels)
        self._buffers = np.zeros((2, num_envs, self.size), np.float32)
        self._turn = 0

    @property
    def current(self) -> Array:
        """The newest observations, (n, size)."""
        return self._buffers[self._turn]

    def advance(self, active: Array | None = None) -> None:
        """Write new observations into the other buffer; games not in ``active`` keep their old ones."""
        old = self.current
        self._turn = 1 - self._turn
        self._fill(ALL, self.current)
        if active is not None:
            np.copyto(self.current, old, where=~active[:, None])

    def refresh(self, rows: Array) -> None:
        """Rewrite the newest observations of the games with these indices only."""
        fresh = np.empty((len(rows), self.size), np.float32)
        self._fill(rows, fresh)
        self.current[rows] = fresh

    def restore(self, observations: Array) -> None:
        """Replace the newest observations, (n, size)."""
        self.current[...] = observations

    def _fill(self, rows: Rows, out: Array) -> None:
        for block, columns in self._parts:
            block.fill(rows, out[:, columns])
