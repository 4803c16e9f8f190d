"""Several environments of one process as one Gymnasium ``Env``, for a vector environment.

All outputs of the games are in the bundle's observation, which uses shared memory. Nothing here raises:
errors of an environment are reported in ``info["failure"]``.
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
from apil_core.common.errors import failures, reason_of
from apil_core.games.pettingzoo.maker import Maker, prints_to_stderr
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
        games: number of environments.
        index: this bundle's row of ``options["seeds"]``.
    """

    def __init__(self, maker: Maker, seats: tuple[Seat, Seat], games: int, index: int):
        self._maker = maker
        self._seats = seats
        self._index = index
        self._games = games
        self._envs: list[ParallelEnv] = []
        self._rows = [np.zeros((games, seat.columns.width)) for seat in seats]
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
        """Start new games where ``options["seeds"][index]`` is not negative; the others continue."""
        seeds = (options or {})["seeds"][self._index]
        return self._shown, self._tried(lambda: self._begin(np.flatnonzero(seeds >= 0), seeds))

    def step(self, action: dict[str, Array]) -> tuple[dict[str, Array], float, bool, bool, dict[str, Any]]:
        """Play one step of the games that are ``active``. The bundle itself never ends."""
        self._shown["reward"][:] = 0
        self._shown["cause"][:] = GOES_ON
        self._shown["winner"][:] = NO_WINNER
        games = np.flatnonzero(action["active"])
        return self._shown, 0.0, False, False, self._tried(lambda: self._step(games, action))

    def close(self) -> None:
        """Close the environments."""
        for env in self._envs:
            with suppress(Exception):  # too late to handle while closing
                env.close()
        self._envs = []

    def picture(self, game: int) -> Any:
        """Result of ``render`` of one environment, or a one-line reason why there is none."""
        try:
            with prints_to_stderr():
                return self._envs[game].render() if self._envs else None
        except failures() as error:
            return reason_of(error)

    def _tried(self, do: Callable[[], None]) -> dict[str, Any]:
        try:
            while len(self._envs) < self._games:
                self._envs.append(self._maker())
            with prints_to_stderr():
                do()
        except failures() as error:
            return {"failure": reason_of(error)}
        return {}

    def _begin(self, games: Array, seeds: Array) -> None:
        for game in games:
            observations, _ = self._envs[game].reset(seed=int(seeds[game]))
            for seat, rows in zip(self._seats, self._rows, strict=True):
                seat.columns.read(observations[seat.agent], rows[game])
        if not self._see(games, np.ones(len(games), bool)).all():
            raise ValueError("reset() gives NaN or infinite observations")

    def _step(self, games: Array, action: dict[str, Array]) -> None:
        rewards = numbers([self._play(int(game), action) for game in games], self._seats)
        fine = self._see(games, np.abs(rewards).max(axis=1, initial=0) < FLOAT32_MAX)
        shown = self._shown
        shown["reward"][games[fine]] = rewards[fine]
        shown["cause"][games[~fine]] = DIVERGED
        shown["winner"][games[~fine]] = NO_WINNER

    def _play(self, game: int, action: dict[str, Array]) -> list[Any]:
        """One step of one game; returns the rewards."""
        env, seats = self._envs[game], self._seats
        actions = {
            seat.agent: seat.actions.single(action[f"action_{i}"][game]) for i, seat in enumerate(seats)
        }
        observations, rewards, terminations, truncations, infos = env.step(actions)
        for seat, rows in zip(seats, self._rows, strict=True):
            if seat.agent in observations:  # else its last observation is kept
                seat.columns.read(observations[seat.agent], rows[game])
        # a two-player game ends when one agent is done
        if any(terminations.values()):
            self._shown["cause"][game] = TERMINATED
        elif any(truncations.values()):
            self._shown["cause"][game] = TRUNCATED
        elif any(seat.agent not in env.agents for seat in seats):
            self._shown["cause"][game] = TERMINATED
        self._shown["winner"][game] = said_winner(infos, seats)
        return [rewards.get(seat.agent, 0.0) for seat in seats]

    def _see(self, games: Array, fine: Array) -> Array:
        """Write the observations of those ``games`` that are ``fine``; returns those with finite numbers."""
        flat = [seat.columns.flat(rows[games]) for seat, rows in zip(self._seats, self._rows, strict=True)]
        for rows in flat:
            fine = fine & np.isfinite(rows).all(axis=1)
        for side, rows in enumerate(flat):
            self._shown[f"observation_{side}"][games[fine]] = rows[fine]
        return fine


def numbers(rewards: list[list[Any]], seats: tuple[Seat, Seat]) -> Array:
    """The agents' rewards, (n, 2) float64.

    Raises:
        ValueError: one is no number.
    """
    with suppress(ValueError):
        array = np.array(rewards)
        if array.shape == (len(rewards), 2) and array.dtype.kind in "biuf":
            return array.astype(np.float64)
    for row in rewards:
        for seat, reward in zip(seats, row, strict=True):
            if np.ndim(reward) or np.asarray(reward).dtype.kind not in "biuf":
                raise ValueError(f"agent {seat.agent!r}: reward {reward!r:.60} is no number")
    return np.zeros((0, 2))


def said_winner(infos: Any, seats: tuple[Seat, Seat]) -> int:
    """Winner according to the agents' infos.

    Raises:
        ValueError: infos are no dicts, or ``winner`` is no bool.
    """
    said = []
    for seat in seats:
        info = infos.get(seat.agent, {}) if isinstance(infos, dict) else infos
        word = info.get("winner") if isinstance(info, dict) else info
        if not isinstance(info, dict) or not (word is None or (np.ndim(word) == 0 and word in (0, 1))):
            raise ValueError(
                f"agent {seat.agent!r}: info {info!r:.60}: expected a dict, any 'winner' in it a bool"
            )
        said.append(word)
    if said == [None, None]:
        return UNSAID
    winners = [side for side, word in enumerate(said) if word]
    return winners[0] if len(winners) == 1 else NO_WINNER


def make_bundle(maker: Maker, seats: tuple[Seat, Seat], games: int, index: int, parent: int) -> Bundle:
    """Make a bundle; in another process than ``parent`` (its id), with the signals and stdout of a worker."""
    if os.getpid() != parent:
        # Ctrl-C reaches the whole process group, but the run has to finish its iteration; and a handler
        # of SIGTERM that came along by fork would keep the worker alive
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        sys.stdout = sys.stderr  # stdout is for results
    return Bundle(maker, seats, games, index)


def _space(shape: tuple[int, ...], dtype: Any) -> Space[Any]:
    """Any array of that shape and type."""
    if np.issubdtype(dtype, np.integer):
        limits = np.iinfo(dtype)
        return Box(limits.min, limits.max, shape, dtype)
    return Box(-np.inf, np.inf, shape, dtype)
