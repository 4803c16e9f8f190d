"""One torch thread for everything that determines results; two functions may run in parallel."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import TypeVar

import torch

_First = TypeVar("_First")
_Second = TypeVar("_Second")


@contextmanager
def one_torch_thread() -> Iterator[None]:
    """Run torch on one thread and restore the caller's setting afterwards; also a decorator.

    The networks are small: more threads gain little, compete with the physics threads for the cores,
    and would make sums, and so weights, depend on the number of CPUs.
    """
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def side_by_side(
    first: Callable[[], _First], second: Callable[[], _Second], *, apart: bool | None = None
) -> tuple[_First, _Second]:
    """Results of two functions without shared mutable state, run in parallel or one after the other.

    torch releases the GIL in its operators, so two threads use two cores. Random numbers that either
    needs are drawn beforehand, or from its own generator.

    Args:
        first: run in a thread of its own if ``apart``; if both fail, its error is raised, as in turn.
        second: run here.
        apart: in parallel; ``None``: if the caller itself runs in a thread of its own, as a function
            returned by a plugin does where the run has spare cores.
    """
    if not (_spare.cores if apart is None else apart):
        return first(), second()
    with ThreadPoolExecutor(1, "apil", _spare.found) as pool:
        future = pool.submit(first)
        try:
            result = second()
        except Exception as error:
            raise future.exception() or error  # noqa: B904  (the other one's does not follow from it)
        return future.result(), result


class _Spare(threading.local):
    """True if this thread may start another one."""

    cores = False

    def found(self) -> None:
        self.cores = True


_spare = _Spare()
