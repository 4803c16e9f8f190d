"""Writing and reading training state so that a crash at any moment loses nothing already saved."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch

from apil_core.common.errors import RunDirError
from apil_core.common.files import write_atomically

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
