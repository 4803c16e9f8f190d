"""The safetensors file of a network (student, converted agent): weights, architecture and provenance."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, get_args

import torch
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor

from apil_core.api.policy import PolicyInfo
from apil_core.common.errors import VictimError
from apil_core.common.files import write_atomically
from apil_core.policies.frozen_policy import FrozenPolicy
from apil_core.policies.network import Kind, NetworkShape, Weights

FORMAT = "apil-student-1"
"""Metadata ``format`` of the files; the number is raised when older code could misread one."""


def weights_sha256(weights: Weights) -> str:
    """Hex digest of names, shapes and values: a student's identity, independent of its metadata."""
    digest = hashlib.sha256()
    for name, tensor in sorted(weights.items()):
        digest.update(f"{name} {tuple(tensor.shape)} ".encode())
        digest.update(tensor.contiguous().numpy().astype("<f4", copy=False).tobytes())
    return digest.hexdigest()


def save_policy(
    path: Path | str,
    shape: NetworkShape,
    weights: Mapping[str, Tensor | NDArray[Any]],
    provenance: Mapping[str, Any],
) -> None:
    """Write a network with its weights, to be loaded as ``safetensors:PATH``.

    Args:
        path: of the file; replaced if it exists.
        shape: of ``weights``.
        weights: named and shaped as :meth:`NetworkShape.tensors` says, tensors or numpy arrays, on the CPU;
            stored in float32.
        provenance: where they are from; stored as JSON, shown by ``apil victims check``.

    Raises:
        VictimError: a tensor is missing, unknown, of another shape or not finite.
    """
    stored = {name: torch.as_tensor(value, dtype=torch.float32) for name, value in weights.items()}
    _verify(stored, shape, str(path))
    metadata = {
        "format": FORMAT,
        "shape": json.dumps(asdict(shape)),
        "weights_sha256": weights_sha256(stored),
        "provenance": json.dumps(provenance, sort_keys=True),
    }
    content = save({name: tensor.contiguous() for name, tensor in stored.items()}, metadata)
    write_atomically(Path(path), lambda file: file.write(content))


def load_file(path: Path, name: str) -> FrozenPolicy:
    """Read what :func:`save_policy` wrote.

    Args:
        path: of the file.
        name: full name the policy gets.

    Raises:
        VictimError: the file is missing, damaged, or no student's.
    """
    if not path.is_file():
        raise VictimError(f"{name}: no file {path}")
    try:
        with safe_open(path, framework="pt") as file:
            metadata = file.metadata() or {}
            weights = {key: file.get_tensor(key) for key in file.keys()}  # noqa: SIM118  (no mapping)
    except (SafetensorError, OSError, ValueError) as error:
        reason = " ".join(str(error).split())
        raise VictimError(f"{name}: {path} is no safetensors file, or a damaged one: {reason}") from error
    shape = _shape(metadata, f"{name}: {path}")
    _verify(weights, shape, f"{name}: {path}")
    _verify_hash(weights, metadata, f"{name}: {path}")
    info = PolicyInfo(
        name, metadata["weights_sha256"], shape.observation_size, shape.action_size, provenance_of(metadata)
    )
    return FrozenPolicy(info, shape, weights)


def _shape(metadata: Mapping[str, str], where: str) -> NetworkShape:
    found = metadata.get("format", "none")
    if found != FORMAT:
        raise VictimError(f"{where} has format {found!r}, expected {FORMAT!r}")
    try:
        values = json.loads(metadata["shape"])
        shape = NetworkShape(**{**values, "hidden": tuple(values["hidden"])})
        _plausible(shape)
    except (KeyError, TypeError, ValueError) as error:
        raise VictimError(f"{where}: its metadata are damaged ({error})") from error
    return shape


def _plausible(shape: NetworkShape) -> None:
    """Check the fields that the tensors' sizes do not determine.

    Raises:
        ValueError: not a shape that can act.
    """
    if shape.kind not in get_args(Kind):
        raise ValueError(f"kind {shape.kind!r} is none of {', '.join(get_args(Kind))}")
    if not isinstance(shape.clip, (int, float)) or not 0 < shape.clip < math.inf:
        raise ValueError(f"clip {shape.clip!r} is no positive number")


def _verify(weights: Weights, shape: NetworkShape, where: str) -> None:
    expected = shape.tensors()
    for name, size in expected.items():
        if name not in weights:
            raise VictimError(f"{where}: tensor {name!r} is missing")
        tensor = weights[name]
        if (tuple(tensor.shape), tensor.dtype) != (size, torch.float32):
            found = f"{tuple(tensor.shape)} {str(tensor.dtype).removeprefix('torch.')}"
            raise VictimError(f"{where}: tensor {name!r} is {found}, expected {size} float32")
        if not tensor.isfinite().all():
            raise VictimError(f"{where}: tensor {name!r} holds numbers that are not finite")
    if weights.keys() != expected.keys():
        raise VictimError(f"{where}: unknown tensors {sorted(weights.keys() - expected.keys())}")


def _verify_hash(weights: Weights, metadata: Mapping[str, str], where: str) -> None:
    actual = weights_sha256(weights)
    if metadata.get("weights_sha256") != actual:
        said = metadata.get("weights_sha256", "none")
        raise VictimError(f"{where}: its weights give SHA-256 {actual}, but the file says {said}")


def provenance_of(metadata: Mapping[str, str]) -> dict[str, str]:
    """The JSON object under ``provenance`` in a file's metadata, values as text, or nothing."""
    try:
        stated = json.loads(metadata.get("provenance", "{}"))
    except json.JSONDecodeError:
        return {}
    return {key: str(value) for key, value in stated.items()} if isinstance(stated, dict) else {}
