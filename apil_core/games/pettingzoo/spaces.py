"""Conversion between flat arrays and an environment's spaces."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium.spaces import (
    Box,
    Dict,
    Discrete,
    MultiBinary,
    MultiDiscrete,
    Space,
    Tuple,
    flatdim,
    flatten,
    flatten_space,
)

from apil_core.api.game import Array, SideLayout
from apil_core.common.errors import ConfigError


class Actions:
    """Conversion of a flat action to one of the environment.

    Of ``Discrete(k)`` a flat action is k scores, of which the largest is chosen (the first of equals); of a
    ``Box`` it is numbers in ±1, scaled linearly to the bounds of each component.

    Attributes:
        size: length of the flat action.
        bound: flat actions lie within ±bound; infinite for scores, which would tie where they are clipped.
        shape, dtype: of the environment's action.
    """

    def __init__(self, space: Box | Discrete):
        self._space = space
        self.shape: tuple[int, ...] = space.shape or ()
        self.dtype: Any = space.dtype
        if isinstance(space, Discrete):
            self.size, self.bound, self.dtype = int(space.n), np.inf, np.int64
            return
        self.size, self.bound = int(np.prod(space.shape)), 1.0
        self._low, self._high = space.low.astype(np.float64), space.high.astype(np.float64)
        self._centre = self._low / 2 + self._high / 2
        self._half = self._high / 2 - self._low / 2

    def native(self, actions: Array) -> Array:
        """The environment's actions, (n, *shape), from flat ones, (n, size)."""
        if isinstance(self._space, Discrete):
            return actions.argmax(1) + int(self._space.start)
        unit = np.clip(actions, -1.0, 1.0).reshape(-1, *self.shape)
        values = np.clip(self._centre + unit * self._half, self._low, self._high)
        whole = np.issubdtype(self.dtype, np.integer)
        return (np.rint(values) if whole else values).astype(self.dtype)

    def single(self, native: Array) -> Any:
        """One row of :meth:`native` as ``step`` takes it."""
        return native.copy() if isinstance(self._space, Box) else int(native)  # step may write to it


class Columns:
    """A flattened observation space: an environment's observations as rows of numbers, checked and flat.

    A ``Discrete`` number takes one column of a row, and as many of the flat observation as it has values.

    Attributes:
        width: of a row.
        size: of the flat observation, in gymnasium's order.
    """

    def __init__(self, agent: str, space: Space[Any]):
        self._agent = agent
        self._space = space
        self._leaves = list(_leaves(space))
        widths = [int(np.prod(leaf.shape or ())) for leaf in self._leaves]
        self._ends = np.cumsum([0, *widths]).tolist()
        self.width = self._ends[-1]
        lows, highs, hots = zip(*map(_bounds, self._leaves), strict=True)
        self._low, self._high = (np.concatenate(bounds).astype(np.float64) for bounds in (lows, highs))
        hot = np.repeat(hots, widths)
        whole = [np.dtype(leaf.dtype).kind in "biu" for leaf in self._leaves]
        self._whole = np.repeat(whole, widths)
        sizes = np.where(hot, self._high - self._low + 1, 1).astype(int)
        starts = np.cumsum(sizes) - sizes
        self.size = int(sizes.sum())
        self._plain, self._hot = np.flatnonzero(~hot), np.flatnonzero(hot)
        self._plain_at, self._hot_at = (
            starts[self._plain],
            starts[self._hot] - self._low[self._hot].astype(int),
        )

    def read(self, observation: Any, row: Array) -> None:
        """Fill ``row`` (width,) float64.

        Raises:
            ValueError: a part is missing, of another shape, or no number.
        """
        parts = list(_parts(self._space, observation))
        if len(parts) != len(self._leaves):
            raise self._outside(self._space, observation)
        for leaf, part, start, end in zip(self._leaves, parts, self._ends, self._ends[1:], strict=False):
            numbers = np.asarray(part)
            if numbers.shape != leaf.shape or numbers.dtype.kind not in "biuf":
                raise self._outside(leaf, part)
            row[start:end] = numbers.ravel()

    def flat(self, rows: Array, *, tried: bool = False) -> Array:
        """Flat observations (n, size) float32 of ``rows`` (n, width).

        Args:
            rows: as :meth:`read` fills them.
            tried: check the range of non-integer numbers too.

        Raises:
            ValueError: a number is outside its space.
        """
        if tried or self._whole.any():
            outside = (rows < self._low) | (rows > self._high) | (self._whole & (rows != np.rint(rows)))
            outside &= self._whole | (tried & np.isfinite(rows))
            if outside.any():
                row, column = np.argwhere(outside)[0]
                leaf = self._leaves[np.searchsorted(self._ends, column, side="right") - 1]
                raise self._outside(leaf, rows[row, column])
        with np.errstate(over="ignore"):  # overflow becomes infinite, which ends the game
            if not len(self._hot):
                return rows.astype(np.float32)
            flat = np.zeros((len(rows), self.size), np.float32)
            flat[:, self._plain_at] = rows[:, self._plain]
        flat[np.arange(len(rows))[:, None], self._hot_at + rows[:, self._hot].astype(int)] = 1
        return flat

    def _outside(self, space: Space[Any], value: Any) -> ValueError:
        shown = " ".join(f"{value}".split())[:60]
        return ValueError(f"agent {self._agent!r}: its observation space {space} has no {shown}")


def _leaves(space: Space[Any]) -> Iterator[Space[Any]]:
    """Spaces of numbers, in gymnasium's order."""
    if isinstance(space, Dict | Tuple):
        for part in space.spaces.values() if isinstance(space, Dict) else space.spaces:
            yield from _leaves(part)
    else:
        yield (
            space if isinstance(space, Box | Discrete | MultiBinary | MultiDiscrete) else flatten_space(space)
        )


def _parts(space: Space[Any], value: Any) -> Iterator[Any]:
    """Parts of an observation for each of :func:`_leaves`; of another number if its structure differs."""
    if isinstance(space, Dict | Tuple):
        parts = dict(space.spaces.items() if isinstance(space, Dict) else enumerate(space.spaces))
        given = value if isinstance(space, Dict) else dict(enumerate(value))
        if given.keys() == parts.keys():
            for key, part in parts.items():
                yield from _parts(part, given[key])
    else:
        numbers = isinstance(space, Box | Discrete | MultiBinary | MultiDiscrete)
        yield value if numbers else flatten(space, value)


def _bounds(space: Space[Any]) -> tuple[Array, Array, bool]:
    """Lowest and highest of each number, and whether each becomes one column per value."""
    if isinstance(space, Box):
        return space.low.ravel(), space.high.ravel(), False
    if isinstance(space, MultiBinary):
        return np.zeros(np.prod(space.shape)), np.ones(np.prod(space.shape)), False
    assert isinstance(space, Discrete | MultiDiscrete)
    count = np.ravel(space.n if isinstance(space, Discrete) else space.nvec)
    first = np.ravel(space.start)
    return first, first + count - 1, True


@dataclass(frozen=True)
class Seat:
    """One agent: its observation and action.

    Attributes:
        agent: its name in the environment.
        space: of its observations.
        columns: flattening of its observations.
        actions: conversion of its actions.
        mask: columns of its flat observation with its ``action_mask``, if it has one.
    """

    agent: str
    space: Space[Any]
    columns: Columns
    actions: Actions
    mask: slice | None = None

    @classmethod
    def of(cls, agent: str, observation: Space[Any], action: Space[Any]) -> Seat:
        """Read an agent's spaces.

        Raises:
            ConfigError: a space is of an unsupported type, or an action mask not of its choices.
        """
        if not observation.is_np_flattenable:
            raise ConfigError(f"agent {agent!r}: observations of {observation} cannot be made flat")
        columns = Columns(agent, observation)
        mask = _blocks(observation).get("action_mask")
        choices = int(action.n) if isinstance(action, Discrete) else 0
        if mask is not None and mask.stop - mask.start != choices:
            raise ConfigError(
                f"agent {agent!r}: its action_mask has {mask.stop - mask.start} numbers, its action space "
                f"{action} {choices} choices"
            )
        if not isinstance(action, Box | Discrete):
            raise ConfigError(f"agent {agent!r}: actions must be a Box or Discrete, these are {action}")
        if isinstance(action, Box) and not action.is_bounded("both"):
            raise ConfigError(f"agent {agent!r}: actions need finite bounds, these are {action}")
        return cls(agent, observation, columns, Actions(action), mask)

    def native(self, actions: Array, observations: Array) -> Array:
        """The environment's actions, (n, …), of which none is forbidden by its mask.

        Args:
            actions: (n, a).
            observations: what they answer, (n, size); a mask of zeros only forbids nothing.
        """
        if self.mask is not None:
            legal = observations[:, self.mask] > 0
            actions = np.where(legal | ~legal.any(1, keepdims=True), actions, -np.inf)
        return self.actions.native(actions)

    @property
    def size(self) -> int:
        """Size of the flat observation."""
        return self.columns.size

    def layout(self, opponent_channels: tuple[int, ...]) -> SideLayout:
        """Layout of this seat; the parts of a ``Dict`` observation are its blocks.

        Raises:
            ConfigError: a channel lies outside the observation.
        """
        outside = [channel for channel in opponent_channels if channel >= self.size]
        if outside:
            raise ConfigError(f"opponent_channels.{self.agent}: {outside[0]} is outside 0–{self.size - 1}")
        channels = tuple(sorted(set(opponent_channels)))
        bound = self.actions.bound
        return SideLayout(
            self.agent, self.size, self.actions.size, -bound, bound, _blocks(self.space), channels
        )


def _blocks(space: Space[Any]) -> dict[str, slice]:
    """Named parts of a flat observation."""
    parts = space.spaces if isinstance(space, Dict) else {"observation": space}
    blocks: dict[str, slice] = {}
    start = 0
    for name, part in parts.items():
        blocks[str(name)] = slice(start, start + flatdim(part))
        start += flatdim(part)
    return blocks
