"""Joining torchrun's processes, and the error when another one has ended."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from datetime import timedelta
from pathlib import Path
from types import TracebackType

import torch

from apil_core.common.errors import ApilError, ConfigError
from apil_core.training.distributed.world import World

TIMEOUT = timedelta(minutes=30)
"""Longest wait for another process that is alive but silent, e.g. while the first one evaluates."""


class ContactLostError(ApilError):
    """Another process of the run has ended."""


@contextmanager
def joined(device: str) -> Iterator[World]:
    """The world of this process, connected until the end of the block; within another such block, that one's.

    CPU tensors use gloo, GPU tensors NCCL.

    Args:
        device: of the networks.

    Raises:
        ConfigError: torchrun's variables are incomplete.
        ContactLostError: in the block, another process ended.
    """
    world = World.here()
    if world.size == 1:
        yield world
        return
    from torch import distributed

    if distributed.is_initialized():
        yield world
        return
    with in_contact():
        _connect(world, device)
        yield world
    # not after an error: it would wait for the others
    distributed.destroy_process_group()


def _connect(world: World, device: str) -> None:
    from torch import distributed

    gpu = world.device(device)
    backend = "gloo"
    if gpu.startswith("cuda"):
        torch.cuda.set_device(gpu)
        backend = "cpu:gloo,cuda:nccl"
    try:
        distributed.init_process_group(backend, timeout=TIMEOUT)
    except ValueError as error:  # a variable is missing
        raise ConfigError(f"{error}; start with torchrun") from error


@contextmanager
def in_contact() -> Iterator[None]:
    """Turn torch's exceptions about an ended process into one line.

    Raises:
        ContactLostError: a collective failed.
    """
    try:
        yield
    except ApilError:
        raise
    except Exception as error:
        if not _in_exchange(error.__traceback__):
            raise
        raise ContactLostError(
            "stopped, because another process of this run ended or was silent for "
            f"{TIMEOUT.total_seconds() / 60:.0f} minutes; its own message or torchrun's says why"
        ) from error


def _in_exchange(traceback: TracebackType | None) -> bool:
    """True if the error was raised in torch's code for collectives."""
    home = Path(torch.__file__).parent / "distributed"
    innermost = ""
    while traceback is not None:
        innermost = traceback.tb_frame.f_code.co_filename
        traceback = traceback.tb_next
    return Path(innermost).is_relative_to(home)
