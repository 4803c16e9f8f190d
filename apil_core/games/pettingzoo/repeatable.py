"""Check that a seed determines a game: otherwise no result could be repeated and no run resumed."""

from __future__ import annotations

from typing import Any

import numpy as np
from pettingzoo import ParallelEnv

from apil_core.api.game import Array
from apil_core.common.errors import ConfigError
from apil_core.games.pettingzoo.bundle import numbers, said_winner
from apil_core.games.pettingzoo.spaces import Seat

STEPS = 10


def check_repeatable(env: ParallelEnv, seats: tuple[Seat, Seat]) -> None:
    """Play the same short game twice and compare.

    Raises:
        ConfigError: the two differ.
    """
    first, second = (_played(env, seats) for _ in range(2))
    same = len(first) == len(second)
    if not same or not all(np.array_equal(a, b, equal_nan=True) for a, b in zip(first, second, strict=True)):
        raise ConfigError("one seed gives different games: reset(seed=) must decide everything random in it")


def _played(env: ParallelEnv, seats: tuple[Seat, Seat]) -> list[Array]:
    """All observations and rewards of a game's first steps, checked."""
    rng = np.random.default_rng(0)
    observations, _ = env.reset(seed=0)
    if missing := [seat.agent for seat in seats if seat.agent not in env.agents]:
        raise ConfigError(
            f"after reset() its 'agents' lack {missing[0]!r}: both must be there until they leave"
        )
    trace = [_seen(seat, observations) for seat in seats]
    seen = {seat.agent: flat for seat, flat in zip(seats, trace, strict=True)}
    for _ in range(STEPS):
        actions = {}
        for seat in seats:
            given = rng.uniform(-1, 1, (1, seat.actions.size))  # of scores only the order matters
            actions[seat.agent] = seat.actions.single(seat.native(given, seen[seat.agent])[0])
        observations, rewards, terminations, truncations, infos = env.step(actions)
        seen |= {seat.agent: _seen(seat, observations) for seat in seats if seat.agent in observations}
        trace += [seen[seat.agent] for seat in seats if seat.agent in observations]
        trace.append(numbers([[rewards.get(seat.agent, 0.0) for seat in seats]], seats))
        said_winner(infos, seats)
        if any(terminations.values()) or any(truncations.values()) or len(env.agents) < 2:
            break
    return trace


def _seen(seat: Seat, observations: dict[str, Any]) -> Array:
    row = np.zeros((1, seat.columns.width))
    seat.columns.read(observations[seat.agent], row[0])
    return seat.columns.flat(row, tried=True)
