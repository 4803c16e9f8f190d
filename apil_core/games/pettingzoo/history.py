"""Seeds and actions of every current game, from which it can be replayed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from apil_core.api.game import Array
from apil_core.games.pettingzoo.spaces import Actions


class History:
    """Seeds and actions of ``num_envs`` games.

    Attributes:
        seeds: of the games, (num_envs,) int64; −1 before the first.
    """

    def __init__(self, num_envs: int, actions: Sequence[Actions]):
        self.seeds = np.full(num_envs, -1, np.int64)
        self._dtypes = [kind.dtype for kind in actions]
        self._actions = [np.zeros((64, num_envs, *kind.shape), kind.dtype) for kind in actions]

    @property
    def empty(self) -> bool:
        """True if no game was started yet."""
        return bool((self.seeds < 0).all())

    def begin(self, mask: Array, seeds: Array) -> None:
        """Start new games where ``mask``; overwrites their history."""
        self.seeds[mask] = seeds[mask]

    def add(self, actions: tuple[Array, Array], clock: Array, playing: Array) -> None:
        """Record the actions, (num_envs, …), of games that have played ``clock`` steps so far."""
        if clock.max(initial=0, where=playing) >= len(self._actions[0]):
            self._actions = [np.concatenate([old, np.zeros_like(old)]) for old in self._actions]
        rows = np.flatnonzero(playing)
        for kept, action in zip(self._actions, actions, strict=True):
            kept[clock[rows], rows] = action[rows]

    def at(self, time: int) -> tuple[Array, Array]:
        """The actions of every game's step ``time`` (from 0)."""
        first, second = (kept[time] for kept in self._actions)
        return first, second

    def state_dict(self, clock: Array) -> dict[str, Any]:
        """The part of the history up to ``clock``."""
        length = int(clock.max(initial=0))
        actions = {str(side): _storable(kept[:length]) for side, kept in enumerate(self._actions)}
        return {"seeds": self.seeds.copy(), "actions": actions}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore the result of :meth:`state_dict`."""
        self.seeds[...] = state["seeds"]
        for side, dtype in enumerate(self._dtypes):
            given = state["actions"][str(side)]
            kept = self._actions[side]
            length = max(len(given), len(kept))
            self._actions[side] = np.zeros((length, *kept.shape[1:]), dtype)
            self._actions[side][: len(given)] = given


def _storable(actions: Array) -> Array:
    """A copy in a type that a checkpoint can hold (torch has few unsigned ones)."""
    return actions.astype(np.int64 if np.issubdtype(actions.dtype, np.integer) else actions.dtype)
