"""Import of upstream's pickles into the cache."""

from __future__ import annotations

import hashlib
import pickletools
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from apil_core.common.errors import VictimError
from apil_core.policies import zoo_cache as cache
from apil_core.policies import zoo_catalogue as catalogue
from apil_core.policies.zoo_catalogue import ZooEntry
from apil_core.policies.zoo_layout import Vector, split, tensor_shapes, vector_length

CONVERTER = "1"
"""Version of the files written here; goes up when names or shapes change."""


@dataclass(frozen=True)
class ImportRow:
    """Result of importing one file.

    Attributes:
        name: the agent, ``"zoo:..."``.
        source: the pickle that was read.
        sha256: of that pickle.
        error: reason why it was refused, one line; empty if it was imported.
    """

    name: str
    source: str
    sha256: str
    error: str = ""


class ZooImportError(VictimError):
    """Some files were refused; every other one is in the cache. One line per refused file.

    Attributes:
        rows: of all files found, refused ones included.
    """

    def __init__(self, rows: list[ImportRow]):
        super().__init__("\n".join(row.error for row in rows if row.error))
        self.rows = rows


def import_zoo(path: str | Path) -> list[ImportRow]:
    """Convert every known pickle below ``path`` and put it into the cache.

    Args:
        path: upstream's ``agent-zoo`` folder, or the folder that holds it. Missing agents and files
            that are not upstream's are passed over.

    Returns:
        one row per imported agent.

    Raises:
        ZooImportError: a file is not what upstream published. The others were imported all the same.
        VictimError: there is nothing to import at ``path``.
    """
    found = {entry: file for entry in catalogue.entries().values() if (file := _find(Path(path), entry))}
    if not found:
        example = next(iter(catalogue.entries().values())).file
        raise VictimError(f"no agents of the zoo below {path} (looked for {example} and the like)")
    rows = [_import(entry, file) for entry, file in found.items()]
    if any(row.error for row in rows):
        raise ZooImportError(rows)
    return rows


def _find(path: Path, entry: ZooEntry) -> Path | None:
    inside = Path(entry.file).relative_to("agent-zoo")
    names = {inside, inside.with_name(inside.name.replace("v1pkl", "v1.pkl"))}  # a copy may have fixed it
    places = [folder / name for folder in (path, path / "agent-zoo") for name in names]
    return next((place for place in places if place.is_file()), None)


def _import(entry: ZooEntry, file: Path) -> ImportRow:
    sha256, error = "", ""
    try:
        data = _read(file)
        sha256 = hashlib.sha256(data).hexdigest()
        if sha256 != entry.sha256:
            raise VictimError(f"{file}: SHA-256 is {sha256}, expected {entry.sha256}; not imported")
        cache.write(entry, *convert(entry, data, str(file)))
    except VictimError as problem:
        error = str(problem)
    return ImportRow(entry.full_name, str(file), sha256, error)


def _read(file: Path) -> bytes:
    try:
        return file.read_bytes()
    except OSError as error:
        raise VictimError(f"{file}: cannot be read ({error.strerror})") from error


def convert(entry: ZooEntry, data: bytes, source: str) -> tuple[dict[str, Vector], dict[str, str]]:
    """Tensors and metadata of a pickle whose SHA-256 has been checked.

    The metadata holds the provenance, and the pickle's bytes before and after the vector, with which
    :func:`apil_core.policies.zoo_cache.read` proves the tensors.

    Raises:
        VictimError: there is no float32 vector of the length this agent has in it.
    """
    raw = _vector_bytes(data, source, vector_length(entry.facts))
    head, _, tail = data.partition(raw)
    metadata = entry.provenance | {
        "name": entry.full_name,
        "pickle_sha256": entry.sha256,
        "pickle_head": head.hex(),
        "pickle_tail": tail.hex(),
        "converter": CONVERTER,
    }
    return split(np.frombuffer(raw, "<f4"), tensor_shapes(entry.facts)), metadata


def _vector_bytes(data: bytes, source: str, length: int) -> bytes:
    """The only byte string in the pickle of such a vector's size; nothing is unpickled."""
    try:
        strings = [argument for _, argument, _ in pickletools.genops(data) if isinstance(argument, bytes)]
    except ValueError as error:
        raise VictimError(f"{source}: not a readable pickle ({error})") from error
    found = [string for string in strings if len(string) == 4 * length]
    if len(found) != 1:
        raise VictimError(f"{source}: refused: no float32 vector of {length} values in it")
    return found[0]
