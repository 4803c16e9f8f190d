"""Detection of in-place changes of a hook's tensors: by copies, as inference mode counts no versions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from typing import Any

from torch import Tensor

RUN = "run"
"""The argument that is not inspected: its contents change all the time."""


def copies(arguments: Mapping[str, object]) -> dict[str, Tensor]:
    """Clones of all tensors in a hook's arguments.

    Searches dataclasses, dicts, lists and tuples, never ``run``.

    Args:
        arguments: of the hook, by name.

    Returns:
        clones by path, such as ``step.reward``, ``rollout.groups[prediction]`` or ``obs``.
    """
    return {path: tensor.detach().clone() for path, tensor in _tensors(arguments)}


def changed(before: Mapping[str, Tensor], arguments: Mapping[str, object]) -> list[str]:
    """Paths whose values differ from ``before``, and added or removed paths.

    Args:
        before: what :func:`copies` gave.
        arguments: the same arguments, now.

    Returns:
        paths in the order of the arguments; NaN counts as equal to NaN.
    """
    now = dict(_tensors(arguments))
    paths = dict.fromkeys([*before, *now])
    return [
        path for path in paths if path not in before or path not in now or not same(before[path], now[path])
    ]


def same(a: Tensor, b: Tensor) -> bool:
    """Return whether two tensors are equal bit for bit; NaN equals NaN."""
    if a.shape != b.shape or a.dtype != b.dtype or a.device != b.device:
        return False
    equal = a == b
    if a.is_floating_point():
        equal = equal | (a.isnan() & b.isnan())
    return bool(equal.all())


def _tensors(arguments: Mapping[str, object]) -> Iterator[tuple[str, Tensor]]:
    for name, value in arguments.items():
        if name != RUN:
            yield from _below(name, value)


def _below(path: str, value: Any) -> Iterator[tuple[str, Tensor]]:
    if isinstance(value, Tensor):
        yield path, value
    elif isinstance(value, Mapping):
        for key, item in value.items():
            yield from _below(f"{path}[{key}]", item)
    elif isinstance(value, (list, tuple)):
        for i, item in enumerate(value):
            yield from _below(f"{path}[{i}]", item)
    elif is_dataclass(value) and not isinstance(value, type):
        for field in fields(value):
            yield from _below(f"{path}.{field.name}", getattr(value, field.name))
