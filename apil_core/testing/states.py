"""Compare saved states: nested dicts and lists of tensors, numbers and strings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import torch


def leaves(value: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """All leaves of nested dicts and lists with their paths."""
    if isinstance(value, Mapping):
        for key, item in value.items():
            yield from leaves(item, f"{path}/{key}")
    elif isinstance(value, (list, tuple)):
        for i, item in enumerate(value):
            yield from leaves(item, f"{path}/{i}")
    else:
        yield path, value


def differences(a: Any, b: Any) -> list[str]:
    """Paths at which two states differ, without wall-clock time and the stored configuration."""
    left, right = dict(leaves(a)), dict(leaves(b))
    paths = [*left, *(path for path in right if path not in left)]
    return [
        path
        for path in paths
        if path != "/wall_seconds"
        and not path.startswith("/config/")
        and not (path in left and path in right and equal(left[path], right[path]))
    ]


def equal(a: Any, b: Any) -> bool:
    """Return whether two leaves are the same bit for bit; NaN equals NaN."""
    if isinstance(a, torch.Tensor) and isinstance(b, torch.Tensor):
        if a.shape != b.shape or a.dtype != b.dtype:
            return False
        return torch.equal(a, b) or bool(((a == b) | (a.isnan() & b.isnan())).all())
    if isinstance(a, torch.Tensor) or isinstance(b, torch.Tensor):
        return False
    return bool(a == b) or (a != a and b != b)
