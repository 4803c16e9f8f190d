"""The bundles of one game: in this process, or spread over workers by Gymnasium's ``AsyncVectorEnv``."""

from __future__ import annotations

import os
from functools import partial
from typing import Any

import numpy as np
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv

from apil_core.api.game import Array
from apil_core.common.errors import PluginError, reason_of
from apil_core.games.pettingzoo.bundle import make_bundle
from apil_core.games.pettingzoo.maker import Maker
from apil_core.games.pettingzoo.spaces import Seat


class Bundles:
    """``num_envs`` environments in equal bundles, one per process; started when first used.

    Args:
        maker: makes the environments.
        seats: of both agents.
        num_envs: number of games; the last bundle may have slots left over.
        threads: number of processes; 0: as many as CPUs, 1: all in this process.
    """

    def __init__(self, maker: Maker, seats: tuple[Seat, Seat], num_envs: int, threads: int):
        workers = min(threads or os.cpu_count() or 1, num_envs)
        self._games = -(-num_envs // workers)
        self._count = -(-num_envs // self._games)
        self._num_envs = num_envs
        self._maker = maker
        self._seats = seats
        self._vector: AsyncVectorEnv | SyncVectorEnv | None = None
        self._busy = False

    def reset(self, seeds: Array) -> dict[str, Array]:
        """Start new games where ``seeds`` (num_envs,) is not negative.

        Returns:
            ``observation_0`` and ``observation_1``, (num_envs, size), of the games just started; the other
            rows and arrays are undefined. Valid until the next call.
        """
        return self._call("reset", options={"seeds": self._split(seeds, -1)})

    def step(self, actions: tuple[Array, Array], active: Array) -> dict[str, Array]:
        """Play one step where ``active`` (num_envs,).

        Returns:
            besides the observations ``reward`` (num_envs, 2), ``cause`` and ``winner`` (num_envs,); rows of
            inactive games mean nothing. Valid until the next call.
        """
        moves = {f"action_{side}": self._split(action, 0) for side, action in enumerate(actions)}
        return self._call("step", {**moves, "active": self._split(active, False)})

    def picture(self, game: int) -> Any:
        """See :meth:`Bundle.picture`; ``None`` before the first reset."""
        if self._vector is None:
            return None
        bundle, slot = divmod(game, self._games)
        return self._vector.call("picture", slot)[bundle]

    def close(self) -> None:
        """End the workers; the next use would start new ones."""
        vector, self._vector = self._vector, None
        if vector is None:
            return
        if self._busy and isinstance(vector, AsyncVectorEnv):  # a worker is dead or does not respond
            for process in vector.processes:
                process.terminate()
                process.join()
            vector.closed = True
        else:
            vector.close()
        self._busy = False

    def _call(self, method: str, *args: Any, **kwargs: Any) -> dict[str, Array]:
        self._busy = True
        try:
            self._vector = self._vector or self._start()
            shown, *_, info = getattr(self._vector, method)(*args, **kwargs)
        except (EOFError, OSError) as error:
            raise self._broken(f"a worker process died ({reason_of(error)})") from error
        self._busy = False
        if "failure" in info:
            texts = [text for text, failed in zip(info["failure"], info["_failure"], strict=True) if failed]
            raise self._broken(f"{method}() failed: {texts[0]}")
        return {name: self._joined(array) for name, array in shown.items()}

    def _start(self) -> AsyncVectorEnv | SyncVectorEnv:
        make = partial(make_bundle, self._maker, self._seats, self._games, parent=os.getpid())
        makers = [partial(make, i) for i in range(self._count)]
        kind = SyncVectorEnv if self._count == 1 else AsyncVectorEnv
        return kind(makers, copy=False, autoreset_mode=AutoresetMode.DISABLED)

    def _split(self, rows: Array, filler: Any) -> Array:
        """(num_envs, …) → (bundles, games, …)."""
        spare = self._count * self._games - self._num_envs
        full = np.concatenate([rows, np.full((spare, *rows.shape[1:]), filler, rows.dtype)])
        return full.reshape(self._count, self._games, *rows.shape[1:])

    def _joined(self, array: Array) -> Array:
        return array.reshape(-1, *array.shape[2:])[: self._num_envs]

    def _broken(self, reason: str) -> PluginError:
        return PluginError(f"game pettingzoo:{self._maker.target}: {reason}")
