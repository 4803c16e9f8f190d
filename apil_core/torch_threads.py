"""One torch thread while results are made."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import torch


@contextmanager
def one_torch_thread() -> Iterator[None]:
    """Run torch on one thread and give the caller's setting back after.

    The networks are small: more threads gain little, fight with the physics threads for the cores,
    and would make sums, hence weights, depend on the number of CPUs.
    """
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)
