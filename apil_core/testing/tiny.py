"""Runs of about a second on the toy game, for tests."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from apil_core.api.config import RunConfig

if TYPE_CHECKING:
    from apil_core.runs.session import RunResult


def tiny_config(method: str = "adrl", env: str = "toy-pursuit", **changes: Any) -> RunConfig:
    """Configuration of a few thousand steps, without evaluation and TensorBoard.

    Args:
        method: attack method.
        env: game.
        changes: any keys of :class:`apil_core.RunConfig`; sections as dicts, which are taken as they are.

    Raises:
        pydantic.ValidationError: a key or value is wrong.
    """
    base: dict[str, Any] = {
        "method": method,
        "env": env,
        "steps": 6 * 512,
        "num_envs": 32,
        "ppo": {"num_steps": 16, "epochs": 2, "minibatches": 2},
        "evaluation": {"episodes": 0},
        "checkpoint": {"every_iterations": 2},
        "recorders": ("jsonl",),
    }
    return RunConfig(**{**base, **changes})


def tiny_run(config_or_method: RunConfig | str, out: Path, plugins: Sequence[str | Path] = ()) -> RunResult:
    """Train with :func:`tiny_config`.

    Args:
        config_or_method: a configuration, or the name of a method.
        out: directory of the run.
        plugins: one-file plugins, besides the configuration's own.

    Raises:
        ApilError: anything wrong with names, options, plugins or the directory.
    """
    from apil_core.runs.runner import run

    config = tiny_config(config_or_method) if isinstance(config_or_method, str) else config_or_method
    files = (*config.plugins, *(str(Path(path)) for path in plugins))
    return run(config.model_copy(update={"plugins": tuple(dict.fromkeys(files))}), out=out)
