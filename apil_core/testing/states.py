"""Comparing and judging saved states: nested dicts and lists of tensors, numbers and strings."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping
from typing import Any

import torch

_PLAIN = (bool, int, float, str, bytes, type(None))


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
    """Paths at which two states differ, wall-clock time and the stored configuration aside."""
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
    """Whether two leaves are the same bit for bit; NaN equals NaN."""
    if isinstance(a, torch.Tensor) and isinstance(b, torch.Tensor):
        if a.shape != b.shape or a.dtype != b.dtype:
            return False
        return torch.equal(a, b) or bool(((a == b) | (a.isnan() & b.isnan())).all())
    if isinstance(a, torch.Tensor) or isinstance(b, torch.Tensor):
        return False
    return bool(a == b) or (a != a and b != b)


def unfit(state: Any, path: str = "") -> str | None:
    """Why a state is not plain: the first value that is neither tensor, number, string, dict nor list.

    Returns:
        a sentence, or ``None`` if all is well.
    """
    if isinstance(state, Mapping):
        for key, item in state.items():
            if type(key) not in (str, int):
                return f"the key {key!r} at {path or 'the top'} is no string"
            if (reason := unfit(item, f"{path}[{key!r}]")) is not None:
                return reason
        return None
    if type(state) in (list, tuple):
        return next((r for i, item in enumerate(state) if (r := unfit(item, f"{path}[{i}]"))), None)
    if isinstance(state, torch.Tensor) or type(state) in _PLAIN:
        return None
    return f"{path or 'the whole'} is a {type(state).__module__}.{type(state).__qualname__}"


def through_a_file(state: Any) -> Any:
    """What is read back from a checkpoint; runs no code that might be in it."""
    file = io.BytesIO()
    torch.save(state, file)
    file.seek(0)
    return torch.load(file, weights_only=True)
