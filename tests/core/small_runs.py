"""Small real runs on the toy game, shared by tests."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import torch

from apil_core import RunConfig


def small_config(method: str = "e_apil", **changes: Any) -> RunConfig:
    """A few thousand steps on ``toy-pursuit``, evaluation and TensorBoard off."""
    base: dict[str, Any] = {
        "method": method,
        "env": "toy-pursuit",
        "steps": 6 * 512,
        "num_envs": 32,
        "ppo": {"num_steps": 16, "epochs": 2, "minibatches": 2},
        "evaluation": {"episodes": 0},
        "checkpoint": {"every_iterations": 2},
        "recorders": ("jsonl",),
    }
    return RunConfig(**{**base, **changes})


def leaves(value: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """All leaves of nested dicts and lists with their paths."""
    if isinstance(value, dict):
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
    skipped = [p for p in left.keys() ^ right.keys() if not p.startswith("/config/")]
    assert skipped == []
    return [
        path
        for path, value in left.items()
        if path != "/wall_seconds"
        and not path.startswith("/config/")
        and not (torch.equal(value, right[path]) if isinstance(value, torch.Tensor) else value == right[path])
    ]
