"""Small real runs on the toy game, shared by tests."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from apil_core import RunConfig, run
from apil_core.config.layers import Layer, merge
from apil_core.testing import tiny_config
from apil_core.testing.states import differences as differences
from apil_core.testing.states import leaves as leaves
from apil_core.training.storage import checkpoint
from apil_core.training.storage.run_dir import RunDir

FEW = {"minibatches": 4}
QUICK = {"apil": {"imitator": FEW, "discriminator": FEW}}
"""APIL's networks learn from rollouts of 512 steps, in a fifth of the time that its 32 minibatches take."""


def small_config(method: str = "e_apil", **changes: Any) -> RunConfig:
    """A few thousand steps on ``toy-pursuit``, evaluation and TensorBoard off."""
    if method in ("apil", "e_apil"):
        changes["options"], _ = merge(QUICK, [Layer(changes.get("options", {}), {})])
    return tiny_config(method, **changes)


def final_state(path: str | Path) -> dict[str, Any]:
    """A run's newest checkpoint."""
    return checkpoint.read(RunDir(path).newest_checkpoint())


def metrics_of(path: str | Path) -> list[dict[str, Any]]:
    """Rows of a run's log."""
    return [json.loads(line) for line in RunDir(path).metrics_path.read_text().splitlines()]


def three_iterations(path: Path) -> RunDir:
    """Train E-APIL for three iterations, each with a checkpoint."""
    run(small_config(steps=3 * 512, checkpoint={"every_iterations": 1, "keep": 3}), out=path)
    return RunDir(path)
