"""Flat numbers on our side, an environment's spaces on the other."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium.spaces import Box, Dict, Discrete, Space, flatdim, flatten

from apil_core.api.game import Array, SideLayout
from apil_core.common.errors import ConfigError


class Actions(ABC):
    """How an action of ours becomes one of the environment.

    Attributes:
        size: length of our action.
        bound: our actions lie within ±bound; infinite for scores, which would tie where they are clipped.
        shape, dtype: of the environment's action.
    """

    size: int
    bound: float
    shape: tuple[int, ...]
    dtype: Any

    @abstractmethod
    def native(self, actions: Array) -> Array:
        """The environment's actions, (n, *shape), for ours, (n, size)."""

    @abstractmethod
    def single(self, native: Array) -> Any:
        """One row of :meth:`native` as ``step`` takes it."""


class Scores(Actions):
    """``Discrete(k)``: k scores, the largest is chosen (the first of equals)."""

    shape, dtype, bound = (), np.int64, np.inf

    def __init__(self, space: Discrete):
        self.size = int(space.n)
        self._start = int(space.start)

    def native(self, actions: Array) -> Array:
        """See :class:`Actions`."""
        return actions.argmax(1) + self._start

    def single(self, native: Array) -> int:
        """See :class:`Actions`."""
        return int(native)


class Scaled(Actions):
    """``Box``: numbers in ±1, scaled linearly to the bounds of each component."""

    bound = 1.0

    def __init__(self, space: Box):
        self.shape, self.dtype = space.shape, space.dtype
        self.size = int(np.prod(space.shape))
        self._low, self._high = space.low.astype(np.float64), space.high.astype(np.float64)
        self._centre = self._low / 2 + self._high / 2
        self._half = self._high / 2 - self._low / 2

    def native(self, actions: Array) -> Array:
        """See :class:`Actions`."""
        unit = np.clip(actions, -1.0, 1.0).reshape(-1, *self.shape)
        values = np.clip(self._centre + unit * self._half, self._low, self._high)
        whole = np.issubdtype(self.dtype, np.integer)
        return (np.rint(values) if whole else values).astype(self.dtype)

    def single(self, native: Array) -> Array:
        """See :class:`Actions`."""
        return native.copy()  # the environment may write to it


@dataclass(frozen=True)
class Seat:
    """One agent: what it sees and does.

    Attributes:
        agent: its name in the environment.
        space: of its observations.
        size: of the flat observation.
        actions: how its actions are made.
    """

    agent: str
    space: Space[Any]
    size: int
    actions: Actions

    @classmethod
    def of(cls, agent: str, observation: Space[Any], action: Space[Any]) -> Seat:
        """Look at an agent's spaces.

        Raises:
            ConfigError: they are of a kind that cannot be a game's.
        """
        if not observation.is_np_flattenable:
            raise ConfigError(f"agent {agent!r}: observations of {observation} cannot be made flat")
        if isinstance(action, Discrete):
            return cls(agent, observation, flatdim(observation), Scores(action))
        if not isinstance(action, Box):
            raise ConfigError(f"agent {agent!r}: actions must be a Box or Discrete, these are {action}")
        if not action.is_bounded("both"):
            raise ConfigError(f"agent {agent!r}: actions need finite bounds, these are {action}")
        return cls(agent, observation, flatdim(observation), Scaled(action))

    def flat(self, observation: Any) -> Array:
        """An observation as (size,) float32."""
        with np.errstate(over="ignore"):  # what does not fit becomes infinite, which ends the game
            return np.asarray(flatten(self.space, observation), np.float32)

    def layout(self, opponent_channels: tuple[int, ...]) -> SideLayout:
        """This seat as the core sees it; the parts of a ``Dict`` observation are its blocks.

        Raises:
            ConfigError: a channel lies outside the observation.
        """
        outside = [channel for channel in opponent_channels if channel >= self.size]
        if outside:
            raise ConfigError(f"opponent_channels.{self.agent}: {outside[0]} is outside 0–{self.size - 1}")
        channels = tuple(sorted(set(opponent_channels)))
        bound = self.actions.bound
        return SideLayout(self.agent, self.size, self.actions.size, -bound, bound, self._blocks(), channels)

    def _blocks(self) -> dict[str, slice]:
        parts = self.space.spaces if isinstance(self.space, Dict) else {"observation": self.space}
        blocks: dict[str, slice] = {}
        start = 0
        for name, space in parts.items():
            blocks[str(name)] = slice(start, start + flatdim(space))
            start += flatdim(space)
        return blocks
