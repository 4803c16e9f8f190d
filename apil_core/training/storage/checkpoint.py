"""Checkpoints: written atomically, read without executing code, compared with the run's settings."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import torch

from apil_core.api.config import RunConfig
from apil_core.common.errors import RunDirError, reason_of
from apil_core.common.files import write_atomically
from apil_core.config.absent import with_absent
from apil_core.config.resolve import flatten
from apil_core.plugins.discovery import PluginRegistry
from apil_core.training.distributed.world import World

MAY_CHANGE = (
    *("steps", "threads", "device", "recorders", "checkpoint", "evaluation", "plugins", "init_from"),
    *("log_rows", "trust", "victim_sha256"),  # the latter is compared with the weights themselves
)
"""Sections of a config that may change on resume."""

POLICY_KEYS = ("method", "env", "ppo", "options", "victim_side")
"""Sections that determine the architecture and inputs of the adversary's networks."""


FORMAT = 1
"""Version of the checkpoint layout; older code refuses newer files."""


def to_tensors(value: Any) -> Any:
    """Nested dicts with numpy arrays turned into tensors, which load without unpickling code."""
    if isinstance(value, np.ndarray):
        # numpy has no 0-stride or read-only trouble once copied; unsigned >8 bit do not exist in torch
        return torch.from_numpy(np.array(value))
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, Mapping):
        return {key: to_tensors(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return type(value)(to_tensors(item) for item in value)
    return value


def save(path: Path, state: dict[str, Any]) -> None:
    """Write ``state`` (nested dicts of tensors, arrays, numbers, strings) to ``path``."""
    payload = to_tensors({"format": FORMAT, **state})
    write_atomically(path, lambda file: torch.save(payload, file))


def read(path: Path, device: torch.device | str = "cpu") -> dict[str, Any]:
    """Read what :func:`save` wrote. Executes no code from the file.

    Raises:
        RunDirError: missing, cut short, damaged, or written by a newer version.
    """
    try:
        state = torch.load(path, map_location=device, weights_only=True)
    except FileNotFoundError as error:
        raise RunDirError(f"no checkpoint at {path}") from error
    except IsADirectoryError as error:
        raise RunDirError(f"{path} is a directory; a checkpoint is a file in a run's checkpoints/") from error
    except Exception as error:
        others = sorted(p.name for p in path.parent.glob("*.pt") if p != path)
        hint = f"; try --checkpoint {path.parent / others[-1]}" if others else ""
        raise RunDirError(f"{path} is damaged or cut short ({type(error).__name__}){hint}") from error
    if not isinstance(state, dict) or "format" not in state:
        raise RunDirError(f"{path} is not an APIL checkpoint")
    if state["format"] > FORMAT:
        raise RunDirError(
            f"{path} has checkpoint format {state['format']}, this version reads up to {FORMAT}: upgrade apil"
        )
    return state


def check_same_run(state: dict[str, Any], config: RunConfig, plugins: PluginRegistry, path: Path) -> None:
    """Compare the configuration stored in a checkpoint with the run's.

    Args:
        state: the checkpoint.
        config: the run's.
        plugins: registry with the meaning of keys that the checkpoint lacks.
        path: of the checkpoint, for the message.

    Raises:
        RunDirError: they differ; names the keys.
    """
    ours = config.model_dump(mode="json")
    check_same_settings(ours, _stored(state, plugins), set(ours) - set(MAY_CHANGE), path)


def check_same_policy(state: dict[str, Any], config: RunConfig, plugins: PluginRegistry, path: Path) -> None:
    """Compare the sections that determine the adversary's networks; observers may differ from training.

    Raises:
        RunDirError: it differs; names the keys.
    """
    methods = state.get("methods", {})

    def of_methods(settings: Mapping[str, Any]) -> dict[str, Any]:
        options = settings["options"]
        if isinstance(options, Mapping):
            options = {name: section for name, section in options.items() if name in methods}
        return {**settings, "options": options}

    ours, theirs = config.model_dump(mode="json"), _stored(state, plugins)
    check_same_settings(of_methods(ours), of_methods(theirs), POLICY_KEYS, path)


def _stored(state: dict[str, Any], plugins: PluginRegistry) -> dict[str, Any]:
    """The settings in a checkpoint, complete; not checked, as they are only compared."""
    stored = state.get("config")
    return with_absent(stored if isinstance(stored, Mapping) else {}, plugins)


def check_same_settings(
    ours: Mapping[str, Any], theirs: Mapping[str, Any], keys: Iterable[str], path: Path
) -> None:
    """Compare settings here with those stored in a checkpoint.

    Args:
        ours, theirs: as JSON has them.
        keys: top-level sections to compare.
        path: of the checkpoint, for the message.

    Raises:
        RunDirError: they differ; names the keys.
    """
    wanted = set(keys)
    here = flatten({key: value for key, value in ours.items() if key in wanted})
    there = flatten({key: value for key, value in theirs.items() if key in wanted})
    different = [
        f"{key} ({there.get(key)!r} there, {here.get(key)!r} here)"
        for key in sorted(here.keys() | there.keys())
        if here.get(key) != there.get(key)
    ]
    if different:
        raise RunDirError(f"{path} is of another run or configuration: {', '.join(different[:4])}")


def check_same_world(state: dict[str, Any], world: World, path: Path) -> None:
    """Check that there are as many processes as before: each resumes its own games.

    Raises:
        RunDirError: the number differs.
    """
    before = World(size=state.get("processes", 1))  # older ones lack the key
    if before.size != world.size:
        raise RunDirError(
            f"{path} is of a run of {before.size} process{'es' * (before.size > 1)}, here are {world.size}; "
            f"continue it with: {before.command} resume DIR"
        )


@contextmanager
def fitting(path: Path) -> Iterator[None]:
    """Turn exceptions of torch and plugins on mismatched state into one line about ``path``.

    Raises:
        RunDirError: the state does not fit.
    """
    try:
        yield
    except (KeyError, ValueError, RuntimeError, TypeError) as error:
        raise RunDirError(f"{path} does not fit this run: {reason_of(error)}") from error
