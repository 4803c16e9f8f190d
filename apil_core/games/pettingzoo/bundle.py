"""Several environments of one process as one Gymnasium ``Env``, which a vector environment can place.

All that the games show is the bundle's observation, so that it travels through shared memory. Nothing
here raises: what goes wrong in an environment is told in ``info["failure"]``.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict, MultiBinary, Space
from pettingzoo import ParallelEnv

from apil_core.api.game import NO_WINNER, Array
from apil_core.games.pettingzoo.maker import Maker, one_line, prints_to_stderr
from apil_core.games.pettingzoo.spaces import Seat

CAUSES = ("terminated", "truncated", "time-up", "diverged")
TERMINATED, TRUNCATED, TIME_UP, DIVERGED = range(4)
GOES_ON = -1
FLOAT32_MAX = float(np.finfo(np.float32).max)
UNSAID = -2
"""Winner where no agent's info has the key ``"winner"``."""


class Bundle(gymnasium.Env[Any, Any]):
    """``games`` environments, made at the first reset.

    Args:
        maker: makes them.
        seats: of the two agents, in order.
        games: how many.
        index: which row of ``options["seeds"]`` is this bundle's.
    """

    def __init__(self, maker: Maker, seats: tuple[Seat, Seat], games: int, index: int):
        self._maker = maker
        self._seats = seats
        self._index = index
        self._games = games
        self._envs: list[ParallelEnv] = []
        rows = {f"observation_{side}": ((games, seat.size), np.float32) for side, seat in enumerate(seats)}
        told = {
            "reward": ((games, 2), np.float64),
            "cause": ((games,), np.int8),
            "winner": ((games,), np.int8),
        }
        kinds = [(seat.actions.shape, seat.actions.dtype) for seat in seats]
        moves = {
            f"action_{side}": _space((games, *shape), dtype) for side, (shape, dtype) in enumerate(kinds)
        }
        self._shown = {name: np.zeros(shape, dtype) for name, (shape, dtype) in {**rows, **told}.items()}
        self.observation_space = Dict({name: _space(a.shape, a.dtype) for name, a in self._shown.items()})
        self.action_space = Dict({**moves, "active": MultiBinary(games)})

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Array], dict[str, Any]]:
        """Start new games where ``options["seeds"][index]`` is not negative; the others go on."""
        seeds = (options or {})["seeds"][self._index]
        return self._shown, self._each(np.flatnonzero(seeds >= 0), lambda i: self._begin(i, int(seeds[i])))

    def step(self, action: dict[str, Array]) -> tuple[dict[str, Array], float, bool, bool, dict[str, Any]]:
        """Play one step of the games that are ``active``. The bundle itself never ends."""
        self._shown["reward"][:] = 0
        self._shown["cause"][:] = GOES_ON
        self._shown["winner"][:] = NO_WINNER
        info = self._each(np.flatnonzero(action["active"]), lambda i: self._play(i, action))
        return self._shown, 0.0, False, False, info

    def close(self) -> None:
        """Close the environments."""
        for env in self._envs:
            with suppress(Exception):  # at the end nobody can do anything about it
                env.close()
        self._envs = []

    def picture(self, game: int) -> Any:
        """What ``render`` of one environment gives, or in one line why it gives nothing."""
        try:
            with prints_to_stderr():
                return self._envs[game].render() if self._envs else None
        except Exception as error:
            return one_line(error)

    def _each(self, games: Array, do: Callable[[int], None]) -> dict[str, Any]:
        try:
            while len(self._envs) < self._games:
                self._envs.append(self._maker())
            with prints_to_stderr():
                for game in games:
                    do(int(game))
        except (Exception, SystemExit) as error:
            return {"failure": one_line(error)}
        return {}

    def _begin(self, game: int, seed: int) -> None:
        observations, _ = self._envs[game].reset(seed=seed)
        rows = [seat.flat(observations[seat.agent]) for seat in self._seats]
        if not all(np.isfinite(row).all() for row in rows):
            raise ValueError("reset() gives NaN or infinite observations")
        self._see(game, rows)

    def _play(self, game: int, action: dict[str, Array]) -> None:
        actions = {
            seat.agent: seat.actions.single(action[f"action_{i}"][game]) for i, seat in enumerate(self._seats)
        }
        observations, rewards, terminations, truncations, infos = self._envs[game].step(actions)
        rows = [
            seat.flat(observations[seat.agent]) if seat.agent in observations else self._row(i, game)
            for i, seat in enumerate(self._seats)
        ]
        reward = np.array([rewards.get(seat.agent, 0.0) for seat in self._seats], np.float64)
        shown = self._shown
        if not all(np.isfinite(row).all() for row in rows) or not (np.abs(reward) < FLOAT32_MAX).all():
            shown["cause"][game] = DIVERGED
            return
        self._see(game, rows)
        shown["reward"][game] = reward
        # one agent out is the end of a game of two
        if any(terminations.values()):
            shown["cause"][game] = TERMINATED
        elif any(truncations.values()):
            shown["cause"][game] = TRUNCATED
        shown["winner"][game] = self._winner(infos)

    def _see(self, game: int, rows: list[Array]) -> None:
        for side, row in enumerate(rows):
            self._row(side, game)[:] = row

    def _row(self, side: int, game: int) -> Array:
        return self._shown[f"observation_{side}"][game]

    def _winner(self, infos: dict[str, dict[str, Any]]) -> int:
        said = [infos.get(seat.agent, {}).get("winner") for seat in self._seats]
        if said == [None, None]:
            return UNSAID
        winners = [side for side, word in enumerate(said) if word]
        return winners[0] if len(winners) == 1 else NO_WINNER


def make_bundle(maker: Maker, seats: tuple[Seat, Seat], games: int, index: int, parent: int) -> Bundle:
    """A bundle; in another process than ``parent`` (its id) also manners for a worker."""
    if os.getpid() != parent:
        # Ctrl-C reaches the whole process group, but the run has to finish its iteration; and a handler
        # of SIGTERM that came along by fork would keep the worker alive
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        sys.stdout = sys.stderr  # stdout is for results
    return Bundle(maker, seats, games, index)


def _space(shape: tuple[int, ...], dtype: Any) -> Space[Any]:
    """Any array of that shape and type."""
    if np.issubdtype(dtype, np.integer):
        limits = np.iinfo(dtype)
        return Box(limits.min, limits.max, shape, dtype)
    return Box(-np.inf, np.inf, shape, dtype)
