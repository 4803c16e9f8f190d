"""Several games in a network that may be made for one: in one call if that is the same, else one by one."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Annotated, Any, Literal

import torch
from pydantic import Field
from torch import Tensor

from apil_core.common.errors import ApilError
from apil_core.policies.foreign.origin import Origin

Call = Callable[[list[Tensor]], Any]
Size = Annotated[int, Field(gt=0)]
State = Size | tuple[Size, Size]
"""Shape of a state: k for (n, k), (layers, k) for (layers, n, k)."""
Way = Literal["together", "rows", "bare"]
"""One call for all games; one for each, (1, k); one for each without an axis of games, (k,)."""

_TRIAL = 3


def games_axis(rank: int) -> int:
    """Axis of the games in an input, (n, k) or (layers, n, k)."""
    return 1 if rank == 3 else 0


def check_shape(origin: Origin, name: str, shape: list[Any], export: str) -> None:
    """Check the shape of an input: (n, k), (layers, n, k), or (k,) for one game.

    Args:
        origin: of the network.
        name: of the input.
        shape: its sizes; one that is free is no int.
        export: how to export a network for any number of games.

    Raises:
        VictimError: it is another one, or made for several games and no other number.
    """
    if len(shape) not in (1, 2, 3):
        raise origin.wrong(f"shape (n, k) or (layers, n, k) for input {name!r}", f"{shape}")
    games = shape[games_axis(len(shape))] if len(shape) > 1 else 1
    if isinstance(games, int) and games != 1:
        raise origin.wrong(f"one or any number of games in input {name!r} ({export})", f"a fixed {games}")


def states_in(shapes: list[list[Any]]) -> tuple[State, ...]:
    """States that the shapes of inputs reveal: all must be (layers, n, k)."""
    right = [len(shape) == 3 and isinstance(shape[0], int) and isinstance(shape[2], int) for shape in shapes]
    return tuple((shape[0], shape[2]) for shape in shapes) if all(right) else ()


class Batch:
    """A network called for any number of games. Inputs, states and outputs are (n, k) here.

    Args:
        ask: calls a network, returns its checked outputs.
        call: the network for any number of games.
        alone: the network for one game; ``None``: ``call`` is known to take any number. Else the way is
            found at the first call, on made-up inputs.
        inputs: number of inputs before the states.
        states: their shapes.
    """

    def __init__(
        self,
        ask: Callable[[Call, list[Tensor]], list[Tensor]],
        call: Call,
        alone: Call | None,
        inputs: int,
        states: tuple[State, ...],
    ):
        self._ask = ask
        self._call = call
        self._alone = alone or call
        self._shapes = (*[None] * inputs, *states)
        self._states = states
        self.way: Way | None = None if alone else "together"

    def __call__(self, inputs: list[Tensor]) -> list[Tensor]:
        """The outputs; a log_std that is the same for all games may be (a,).

        Raises:
            VictimError: of ``ask``.
        """
        if self.way is None:
            self.way = self._find_way(inputs)
        return self._play(self.way, inputs)

    def _find_way(self, inputs: list[Tensor]) -> Way:
        """The fastest way that leaves games independent of each other."""
        generator = torch.Generator().manual_seed(0)
        trial = [torch.randn(_TRIAL, part.shape[1], generator=generator).to(part) for part in inputs]
        found: dict[Way, list[Tensor]] = {}
        ways: tuple[Way, ...] = ("together", "rows", "bare")
        with torch.random.fork_rng(devices=[]):
            for way in ways:
                with suppress(ApilError):
                    outputs = self._play(way, trial)
                    if outputs[0].shape[:-1] == (_TRIAL,):
                        found[way] = outputs
                if "rows" in found:
                    break
            if found.keys() == {"together", "rows"} and not alike(found["together"], found["rows"]):
                draws = not alike(found["together"], self._play("together", trial))
                return "together" if draws else "rows"
        return next(iter(found), "together")

    def _play(self, way: Way, inputs: list[Tensor]) -> list[Tensor]:
        if way == "together":
            return self._answer(self._call, way, inputs)
        games = zip(*(part.split(1) for part in inputs), strict=True)
        answers = [self._answer(self._alone, way, list(game)) for game in games]
        return [torch.cat(parts) for parts in zip(*answers, strict=True)]

    def _answer(self, call: Call, way: Way, inputs: list[Tensor]) -> list[Tensor]:
        given = [_native(part, shape, way) for part, shape in zip(inputs, self._shapes, strict=True)]
        outputs = self._ask(call, given)
        shapes = (*[None] * (len(outputs) - len(self._states)), *self._states)
        return [_flat(part, shape, way) for part, shape in zip(outputs, shapes, strict=True)]


def _native(part: Tensor, shape: State | None, way: Way) -> Tensor:
    """As the network takes it, from (n, k)."""
    if isinstance(shape, tuple):
        part = part.unflatten(1, shape).transpose(0, 1).contiguous()
        return part.squeeze(1) if way == "bare" else part
    return part.squeeze(0) if way == "bare" else part


def _flat(part: Tensor, shape: State | None, way: Way) -> Tensor:
    """(n, k) from what the network gives; a choice (n,) becomes (n, 1)."""
    if isinstance(shape, tuple) and part.dim() == 3 - (way == "bare"):
        return part.flatten()[None] if way == "bare" else part.transpose(0, 1).flatten(1)
    if part.dim() < 2 and not part.is_floating_point():
        return part.reshape(-1, 1)
    return part[None] if way == "bare" or (way == "rows" and part.dim() < 2) else part


def alike(left: list[Tensor], right: list[Tensor]) -> bool:
    """True if outputs are the same up to rounding."""
    return all(
        torch.allclose(a, b, rtol=1e-4, atol=1e-5, equal_nan=True) for a, b in zip(left, right, strict=True)
    )
