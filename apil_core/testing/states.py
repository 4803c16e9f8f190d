"""Compare saved states: nested dicts and lists of tensors, numbers and strings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from torch import Tensor

from apil_core.plugins.unchanged import same


def leaves(value: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """All leaves of nested dicts and lists with their paths."""
    if isinstance(value, (Mapping, list, tuple)):
        for key, item in value.items() if isinstance(value, Mapping) else enumerate(value):
            yield from leaves(item, f"{path}/{key}")
    else:
        yield path, value


def differences(a: Any, b: Any) -> list[str]:
    """Paths at which two states differ, without wall-clock time and the stored configuration."""
    left, right = dict(leaves(a)), dict(leaves(b))
    return [
        path
        for path in dict.fromkeys([*left, *right])
        if path != "/wall_seconds"
        and not path.startswith("/config/")
        and not (path in left and path in right and _equal(left[path], right[path]))
    ]


def _equal(a: Any, b: Any) -> bool:
    """Return whether two leaves are the same bit for bit; NaN equals NaN."""
    if isinstance(a, Tensor) or isinstance(b, Tensor):
        return isinstance(a, Tensor) and isinstance(b, Tensor) and same(a, b)
    return bool(a == b) or (a != a and b != b)
