"""Checks that a policy conforms to :class:`apil_core.Policy`, for the seat it is loaded for."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import torch
from torch import Tensor

from apil_core.api.game import SideLayout
from apil_core.api.policy import Policy
from apil_core.api.types import Decision, View
from apil_core.common.errors import ApilError, VictimError, failures, reason_of

_GAMES = 4
_SEED = 0


@dataclass
class Conformance:
    """Result of the checks.

    Attributes:
        errors: violations; empty for a policy that can play.
        notes: permitted behaviour that users should be aware of.
        recurrent: actions depend on earlier observations.
        stochastic: it draws its actions.
        random_mode: even its mode is random.
    """

    errors: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    recurrent: bool = False
    stochastic: bool = False
    random_mode: bool = False


class _BrokenError(Exception):
    """Violation of the policy interface; described in the message."""


def check_policy(
    policy: Policy,
    seat: SideLayout,
    opponent: SideLayout | None = None,
    *,
    second: bool = False,
    device: str = "cpu",
) -> Conformance:
    """Run :func:`examine` and raise if the policy cannot play.

    Raises:
        VictimError: it cannot play here; the message names the first violation.
    """
    found = examine(policy, seat, opponent, second=second, device=device)
    if found.errors:
        raise VictimError(f"{policy.info.name}: {found.errors[0]}")
    return found


def examine(
    policy: Policy,
    seat: SideLayout,
    opponent: SideLayout | None = None,
    *,
    second: bool = False,
    device: str = "cpu",
) -> Conformance:
    """Run a policy on random observations and check its outputs.

    Checks shapes, dtypes, finiteness, the distribution, that the start of a game resets the state,
    that the number of games may change, and declared action bounds. The policy's state is restored.

    Args:
        policy: to check.
        seat: of the policy.
        opponent: the other seat, whose observation it may read; default: as ``seat``.
        second: it acts after its opponent and may read its opponent's action.
        device: of the policy.
    """
    found = Conformance()
    declared, bounds = policy.info.action_bounds, (seat.action_low, seat.action_high)
    if declared is not None and not seat.discrete and not _close(declared, bounds):
        found.errors.append(
            f"made for actions in [{_numbers(declared)}], but the {seat.name}'s are in [{_numbers(bounds)}]"
        )
    before = copy.deepcopy(policy.recurrent_state())
    trial = _Trial(policy, seat, opponent or seat, second, before, device)
    try:
        _look(trial, found)
    except _BrokenError as error:
        found.errors.append(str(error))
    finally:
        policy.load_recurrent_state(before)
    return found


def _look(trial: _Trial, found: Conformance) -> None:
    games, seat = _GAMES, trial.seat
    one, other = trial.observations(games, 0), trial.observations(games, 1)
    mode = trial.fresh(one)
    found.stochastic = mode.distribution is not None or not _same(
        trial.fresh(one, sample=True).action, trial.act(one, sample=True, seed=1).action
    )
    found.random_mode = not _same(mode.action, trial.fresh(one).action)
    for count in (1, games + 1):
        trial.act(trial.observations(count, 2))
    if not found.random_mode:
        found.recurrent = not _same(trial.second(one, other), trial.second(other, other))
        restart = torch.arange(games) < games // 2
        left, right = (trial.second(first, other, restart)[restart] for first in (one, other))
        if not _same(left, right):
            raise _BrokenError("a new game depends on the game before it: clear the rows where view.first")
    else:
        found.notes.append("its mode is random too, so its state could not be checked")
    low, high = float(mode.action.min()), float(mode.action.max())
    if trial.policy.info.action_bounds is None and (low < seat.action_low or high > seat.action_high):
        found.notes.append(
            f"actions in [{_numbers((low, high))}] for made-up observations; the game clips them to "
            f"[{_numbers((seat.action_low, seat.action_high))}]"
        )


@dataclass
class _Trial:
    """A policy under test.

    Attributes:
        policy, seat, opponent, device: as in :func:`examine`.
        second_mover: it sees its opponent's action.
        state: of the policy before the first call.
    """

    policy: Policy
    seat: SideLayout
    opponent: SideLayout
    second_mover: bool
    state: dict[str, Any]
    device: str

    def observations(self, games: int, number: int) -> Tensor:
        """(games, o + o'): standard normal, the seat's own and its opponent's."""
        generator = torch.Generator().manual_seed(number)
        width = self.seat.observation_size + self.opponent.observation_size
        return torch.randn(games, width, generator=generator)

    def fresh(self, rows: Tensor, *, sample: bool = False) -> Decision:
        """Decision for ``rows`` as first observations, from the initial state."""
        self.policy.load_recurrent_state(copy.deepcopy(self.state))
        return self.act(rows, sample=sample)

    def second(self, rows: Tensor, following: Tensor, first: Tensor | None = None) -> Tensor:
        """Mode of the second step of games that began with ``rows``; some may be new again (``first``)."""
        self.fresh(rows)
        return self.act(
            following, torch.zeros(len(rows), dtype=torch.bool) if first is None else first
        ).action

    def act(
        self, rows: Tensor, first: Tensor | None = None, *, sample: bool = False, seed: int = _SEED
    ) -> Decision:
        """One checked decision.

        Raises:
            _BrokenError: it is not what it must be.
        """
        own, opponent = rows.split((self.seat.observation_size, self.opponent.observation_size), dim=1)
        device = self.device
        first = torch.ones(len(rows), dtype=torch.bool) if first is None else first
        theirs = torch.zeros(len(rows), self.opponent.action_size, device=device)
        view = View(
            own.to(device), opponent.to(device), first.to(device), theirs if self.second_mover else None
        )
        generator = torch.Generator(device=device).manual_seed(seed)
        with _reported(len(rows)), torch.no_grad():
            decision = self.policy.act(view, sample=sample, generator=generator)
        _check(decision, (len(rows), self.seat.action_size))
        return decision


@contextmanager
def _reported(games: int) -> Iterator[None]:
    """Turn a policy's failure into an error that states the number of games."""
    try:
        yield
    except ApilError:
        raise
    except failures() as error:
        raise _BrokenError(f"fails on {games} games: {reason_of(error)}") from error


def _check(decision: Decision, shape: tuple[int, int]) -> None:
    parts: list[tuple[str, object, Callable[[tuple[int, ...]], bool]]] = [
        ("action", decision.action, lambda found: found == shape)
    ]
    if decision.distribution is not None:
        parts += [
            ("distribution.mean", decision.distribution.mean, lambda found: found == shape),
            ("distribution.std", decision.distribution.std, lambda found: found in (shape, shape[1:])),
        ]
    for name, value, fits in parts:
        if not isinstance(value, Tensor):
            raise _BrokenError(f"{name} must be a tensor, got {type(value).__name__}")
        if not fits(tuple(value.shape)):
            raise _BrokenError(f"{name} must have shape {shape}, got {tuple(value.shape)}")
        if value.dtype != torch.float32:
            raise _BrokenError(f"{name} must be float32, got {str(value.dtype).removeprefix('torch.')}")
        if not torch.isfinite(value).all():
            raise _BrokenError(f"{name} has NaN or infinite values")
    if decision.distribution is not None and not (decision.distribution.std > 0).all():
        raise _BrokenError("distribution.std must be positive")


def _same(left: Tensor, right: Tensor) -> bool:
    return torch.allclose(left, right, rtol=1e-4, atol=1e-5)


def _close(left: tuple[float, float], right: tuple[float, float]) -> bool:
    return all(math.isclose(a, b, rel_tol=1e-5) for a, b in zip(left, right, strict=True))


def _numbers(values: tuple[float, float]) -> str:
    return ", ".join(f"{value:g}" for value in values)
