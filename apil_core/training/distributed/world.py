"""The processes that train a run together: this one's rank, and exchanges between them.

Started without torchrun there is one process, and everything here does nothing. Imports no torch in a
single process.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

from apil_core.common.errors import ConfigError

if TYPE_CHECKING:
    from torch import Tensor

T = TypeVar("T")

_VARIABLES = {
    "rank": "RANK",
    "size": "WORLD_SIZE",
    "local_rank": "LOCAL_RANK",
    "local_size": "LOCAL_WORLD_SIZE",
}


@dataclass(frozen=True)
class World:
    """All processes of a run, seen from one of them.

    The methods that exchange something must be called by all processes in the same order.

    Attributes:
        rank: number of this process, from 0; the first one writes, prints and evaluates.
        size: how many there are.
        local_rank, local_size: the same among those on this machine.
    """

    rank: int = 0
    size: int = 1
    local_rank: int = 0
    local_size: int = 1

    @classmethod
    def here(cls) -> World:
        """As torchrun's environment variables have it; one process if there are none.

        Raises:
            ConfigError: they are inconsistent.
        """
        found = {key: os.environ[name] for key, name in _VARIABLES.items() if os.environ.get(name)}
        if "rank" not in found or "size" not in found:
            return cls()
        try:
            world = cls(**{key: int(value) for key, value in found.items()})
        except ValueError as error:
            raise ConfigError(f"torchrun's variables: {error}") from error
        if not 0 <= world.rank < world.size:
            raise ConfigError(f"torchrun's variables: RANK {world.rank} of WORLD_SIZE {world.size}")
        return world

    @property
    def is_main(self) -> bool:
        """True for the first process."""
        return self.rank == 0

    @property
    def command(self) -> str:
        """Command that starts the command line in as many processes."""
        return (
            "apil"
            if self.size == 1
            else f"torchrun --standalone --nproc-per-node {self.size} -m apil_core.cli"
        )

    @property
    def multi_gpu_cfg(self) -> dict[str, int] | None:
        """The same as rsl_rl's algorithms take it."""
        if self.size == 1:
            return None
        return {"global_rank": self.rank, "local_rank": self.local_rank, "world_size": self.size}

    def seed(self, seed: int) -> int:
        """This process's seed, derived from a run's ``seed``: equal to it in the first process."""
        if self.is_main:
            return seed
        from apil_core.common.seeds import stream_seed

        return stream_seed(seed, f"rank {self.rank}")

    def threads(self, threads: int) -> int:
        """Threads of this process: 0 (all CPUs) is shared out among those on this machine."""
        if threads or self.local_size == 1:
            return threads
        return max(1, (os.cpu_count() or 1) // self.local_size)

    def device(self, name: str) -> str:
        """The device of this process: with CUDA one GPU per process.

        Raises:
            ConfigError: this machine has fewer GPUs than processes.
        """
        if self.size == 1 or not name.startswith("cuda"):
            return name
        import torch

        if self.local_rank >= torch.cuda.device_count():
            raise ConfigError(
                f"device: {self.local_size} processes on this machine, but {torch.cuda.device_count()} GPUs; "
                "start one process per GPU"
            )
        return f"cuda:{self.local_rank}"

    def any(self, flag: bool) -> bool:
        """Logical or of all processes' ``flag``; the same answer in all."""
        if self.size == 1:
            return flag
        import torch
        from torch import distributed

        flags = torch.tensor(int(flag))
        distributed.all_reduce(flags, distributed.ReduceOp.MAX)
        return bool(flags)

    def share(self, value: T) -> T:
        """The first process's ``value``; the others wait for it."""
        if self.size == 1:
            return value
        from torch import distributed

        values = [value]
        distributed.broadcast_object_list(values, src=0)
        return values[0]

    def gather(self, value: T) -> list[T]:
        """Every process's ``value``, by rank."""
        if self.size == 1:
            return [value]
        from torch import distributed

        values = [value] * self.size
        distributed.all_gather_object(values, value)
        return values

    def wait(self) -> None:
        """Wait until all processes have called this."""
        self.any(False)

    def broadcast(self, tensors: Sequence[Tensor]) -> None:
        """Overwrite ``tensors`` with the first process's."""
        if self.size == 1:
            return
        from torch import distributed

        for tensor in tensors:
            distributed.broadcast(tensor.detach(), src=0)


ALONE = World()
"""The only process of its run."""
