"""Converted agents on this machine: one safetensors file each, verified by upstream's SHA-256.

A file stores the few bytes before and after the vector in the pickle. With them the pickle can be rebuilt
and its published SHA-256 verified at every load, so that a changed file is detected.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Mapping
from pathlib import Path

import platformdirs
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from apil_core.common.errors import VictimError
from apil_core.policies.zoo_catalogue import ZooEntry
from apil_core.policies.zoo_layout import Vector, join, tensor_shapes

_SEAL = "metadata_sha256"


def cache_dir() -> Path:
    """Directory of converted agents: ``$APIL_CACHE``, or the user's cache folder. Not created here."""
    chosen = os.environ.get("APIL_CACHE")
    return Path(chosen).expanduser() if chosen else platformdirs.user_cache_path("apil")


def cached_file(entry: ZooEntry) -> Path:
    """Path of ``entry`` in the cache, whether it is there or not."""
    return cache_dir() / "zoo" / f"{entry.name}.safetensors"


def write(entry: ZooEntry, tensors: Mapping[str, Vector], metadata: dict[str, str]) -> None:
    """Store an agent under its name, atomically."""
    target = cached_file(entry)
    content = save(dict(tensors), {**metadata, _SEAL: _seal(metadata)})
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=target.parent, suffix=".part", delete=False) as part:
            try:
                part.write(content)
                part.close()
                os.replace(part.name, target)
            except BaseException:
                Path(part.name).unlink(missing_ok=True)
                raise
    except OSError as error:
        raise VictimError(f"cannot write {target}: {error.strerror or error}") from error


def read(entry: ZooEntry) -> dict[str, Vector]:
    """The tensors of a cached agent, named as in :func:`apil_core.policies.zoo_layout.tensor_shapes`.

    Raises:
        VictimError: the file is missing, damaged, or not what upstream published.
    """
    path = cached_file(entry)
    if not path.is_file():
        raise VictimError(
            f"{entry.full_name} is not on this machine; get it with `apil victims import DIR` "
            f"(DIR: a copy of upstream's agent-zoo) or `apil victims download`"
        )
    try:
        with safe_open(path, framework="numpy") as file:
            metadata = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118  (no mapping)
    except (SafetensorError, OSError, ValueError) as error:
        raise _damaged(entry, " ".join(str(error).split())) from error
    _verify(entry, tensors, metadata)
    return tensors


def _verify(entry: ZooEntry, tensors: Mapping[str, Vector], metadata: Mapping[str, str]) -> None:
    shapes = tensor_shapes(entry.facts)
    found = {name: (part.shape, part.dtype.name) for name, part in tensors.items()}
    if found != {name: (shape, "float32") for name, shape in shapes.items()}:
        raise _damaged(entry, "its tensors are not those of this agent")
    if metadata.get(_SEAL) != _seal(metadata):
        raise _damaged(entry, "its metadata was changed")
    try:
        head, tail = (bytes.fromhex(metadata[key]) for key in ("pickle_head", "pickle_tail"))
    except (KeyError, ValueError):
        raise _damaged(entry, "its metadata is incomplete") from None
    actual = hashlib.sha256(
        head + join(tensors, shapes).astype("<f4", copy=False).tobytes() + tail
    ).hexdigest()
    if actual != entry.sha256:
        raise _damaged(entry, f"its content gives SHA-256 {actual}, expected {entry.sha256}")


def _seal(metadata: Mapping[str, str]) -> str:
    """SHA-256 of all other metadata, so that the provenance is verified like the content."""
    rest = sorted((key, value) for key, value in metadata.items() if key != _SEAL)
    return hashlib.sha256(repr(rest).encode()).hexdigest()


def _damaged(entry: ZooEntry, reason: str) -> VictimError:
    return VictimError(
        f"{entry.full_name}: {cached_file(entry)} is damaged ({reason}); import or download it again"
    )
