"""Small real runs on the toy game, shared by tests."""

from __future__ import annotations

from typing import Any

from apil_core import RunConfig
from apil_core.testing import tiny_config
from apil_core.testing.states import differences as differences
from apil_core.testing.states import leaves as leaves


def small_config(method: str = "e_apil", **changes: Any) -> RunConfig:
    """A few thousand steps on ``toy-pursuit``, evaluation and TensorBoard off."""
    return tiny_config(method, **changes)
