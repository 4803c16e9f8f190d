"""Synchronisation of methods' learnt state between processes, for any method (docs/distributed.md).

Plugins need no code for this: each process's methods learn from its own games, and once per iteration
their weights and optimisers are averaged and their statistics pooled ("local SGD", Stich 2019).
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import torch
from torch import Tensor, nn
from torch.optim import Optimizer

from apil_core.common.errors import PluginError
from apil_core.training.distributed.moments import pool
from apil_core.training.distributed.world import World
from apil_core.training.normalize import ObservationNormalizer, ReturnNormalizer, RunningMoments

Part = nn.Module | Optimizer

_NOT_AVERAGED = (RunningMoments, ObservationNormalizer, ReturnNormalizer)
"""Modules whose buffers are pooled, derived from pooled ones, or specific to single games."""


def parts(value: Any) -> list[Part]:
    """Modules and optimisers in (nested) lists, tuples and dicts, and in attributes of modules found there.

    Each once, in order of definition.
    """
    found: dict[int, Part] = {}
    for part in _search(value, found):
        found[id(part)] = part
    return list(found.values())


def _search(value: Any, found: Mapping[int, Part]) -> Iterator[Part]:
    if isinstance(value, (nn.Module, Optimizer)):
        if id(value) in found:
            return
        yield value
        if isinstance(value, nn.Module):
            yield from _search(vars(value), found)
    elif isinstance(value, Mapping):
        for item in value.values():
            yield from _search(item, found)
    elif isinstance(value, (list, tuple)):
        for item in value:
            yield from _search(item, found)


def averaged(held: Sequence[Part]) -> list[Tensor]:
    """The floating-point tensors of ``held`` that are averaged: weights, buffers, optimisers' moments."""
    tensors: dict[int, Tensor] = {}
    for part in held:
        if isinstance(part, Optimizer):
            values = [value for state in part.state.values() for value in state.values()]
        elif isinstance(part, _NOT_AVERAGED):
            continue
        else:
            values = [*part.parameters(recurse=False), *part.buffers(recurse=False)]
        for value in values:
            if isinstance(value, Tensor) and value.is_floating_point():
                tensors[id(value)] = value
    return list(tensors.values())


@torch.no_grad()
def average(world: World, tensors: Sequence[Tensor]) -> None:
    """Overwrite ``tensors`` with their means over all processes; one exchange, in double precision."""
    from torch import distributed

    if not tensors:
        return
    # with networks on a GPU, Adam still counts its steps on the CPU
    device = tensors[0].device
    flat = torch.cat([tensor.detach().reshape(-1).to(device, torch.float64) for tensor in tensors])
    distributed.all_reduce(flat)
    flat /= world.size
    for tensor, mean in zip(tensors, flat.split([tensor.numel() for tensor in tensors]), strict=True):
        tensor.copy_(mean.view_as(tensor))


class Replicas:
    """Networks and statistics of a run's processes, made equal once per iteration.

    Args:
        world: of the processes.
        plugins: the run's methods and observers, by name.
        statistics: modules with running statistics that belong to none of them.
    """

    def __init__(self, world: World, plugins: Mapping[str, Any], statistics: Sequence[nn.Module]):
        self._world = world
        self._plugins = plugins
        self._statistics = statistics

    def start_equal(self) -> None:
        """Give all processes the first one's networks."""
        if self._world.size > 1:
            self._world.broadcast(averaged(self._parts()))

    def agree(self, steps: int) -> None:
        """Average weights and pool statistics.

        Args:
            steps: that this process has played; must be the same in all.

        Raises:
            PluginError: in another process a plugin holds other things, or has played more or less.
        """
        if self._world.size == 1:
            return
        held = self._parts()
        tensors = averaged(held)
        self._check(tensors, steps)
        average(self._world, tensors)
        pool(self._world, [part for part in held if isinstance(part, nn.Module)])

    def _parts(self) -> list[Part]:
        return parts([vars(method) for method in self._plugins.values()] + [list(self._statistics)])

    def _check(self, tensors: Sequence[Tensor], steps: int) -> None:
        shapes = repr([tuple(tensor.shape) for tensor in tensors])
        mine = (zlib.crc32(shapes.encode()), steps)
        others = self._world.gather(mine)
        if any(other != mine for other in others):
            names = ", ".join(self._plugins)
            what = "steps played" if all(other[0] == mine[0] for other in others) else "networks"
            raise PluginError(
                f"{names}: {what} differ between the processes of this run; train it in one process"
            )
