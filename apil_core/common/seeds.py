"""Independent random streams from one seed."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import torch


def stream_seed(seed: int, stream: str) -> int:
    """Seed of the named stream of ``seed``; streams of different names never coincide in practice.

    Plain ``seed + 1`` etc. would: two generators with one seed give the same numbers, and
    noise in one place becomes an oracle of the other.
    """
    entropy = np.random.SeedSequence([seed, zlib.crc32(stream.encode())])
    return int(entropy.generate_state(1, np.uint64)[0] >> np.uint64(1))


def stream_generator(seed: int, stream: str, device: torch.device) -> torch.Generator:
    """A torch generator on ``device`` for the named stream."""
    return torch.Generator(device=device).manual_seed(stream_seed(seed, stream))


@contextmanager
def undisturbed(device: torch.device) -> Iterator[None]:
    """Restore torch's global generators, the GPU's of ``device`` included, at the end of the block."""
    with torch.random.fork_rng(devices=[device] if device.type == "cuda" else []):
        yield
