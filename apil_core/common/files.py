"""Atomic file writes, locks and hashes. Imports no torch."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, BinaryIO

from apil_core.common.errors import ApilError, ConfigError, RunDirError

LOCK = ".lock"
"""Name of the lock of a directory."""


_LONGEST = 200
"""Characters of a name that its temporary neighbour's has: file systems take 255 bytes."""


def write_atomically(path: Path, write: Callable[[BinaryIO], object]) -> None:
    """Call ``write(file)`` on a temporary file beside ``path``, fsync it, and rename it to ``path``.

    Raises:
        RunDirError: the directory cannot be written (full, read-only, missing).
    """
    temporary = path.with_name(f".{path.name[:_LONGEST]}.tmp")
    try:
        with temporary.open("wb") as file:
            write(file)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
        directory = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(directory)  # makes the rename survive a power failure
        finally:
            os.close(directory)
    except BaseException as error:
        with suppress(OSError):
            temporary.unlink()
        if not isinstance(error, (OSError, RuntimeError)):  # torch.save reports a full disk as RuntimeError
            raise
        root: BaseException | None = error
        while root is not None and not isinstance(root, OSError):
            root = root.__context__
        reason = getattr(root, "strerror", None) or error
        raise RunDirError(f"cannot write {path}: {reason}; what was there before is untouched") from error


def read_json(path: Path, kind: type = dict) -> Any:
    """Contents of a JSON file, or ``None`` if there is no such file.

    Args:
        path: the file.
        kind: of its outermost value.

    Raises:
        RunDirError: it cannot be read, is not JSON in UTF-8, or another kind of value.
    """
    try:
        value = json.loads(path.read_text("utf-8"))
    except FileNotFoundError:
        return None
    except (OSError, ValueError, RecursionError) as error:
        raise RunDirError(f"{path} is damaged: {error}") from error
    if not isinstance(value, kind):
        raise RunDirError(f"{path} is damaged: it holds a {type(value).__name__}, not a {kind.__name__}")
    return value


def why_unwritable(directory: Path) -> str | None:
    """Reason why no file can be created there, or ``None``; tried, since permissions do not bind root."""
    try:
        with TemporaryFile(dir=directory):
            return None
    except OSError as error:
        return error.strerror or type(error).__name__


def check_place(path: Path) -> None:
    """Check that a file can be written there, before hours of work depend on it.

    Raises:
        ConfigError: it cannot.
    """
    if path.is_dir():
        raise ConfigError(f"{path}: is a directory")
    if not path.parent.is_dir():
        raise ConfigError(f"{path}: its directory does not exist")
    if (reason := why_unwritable(path.parent)) is not None:
        raise ConfigError(f"{path}: cannot be written: {reason}")


def check_free(path: Path, *, force: bool = False) -> None:
    """Check that writing would not replace an existing file.

    Raises:
        ConfigError: the path exists, and ``force`` is false.
    """
    if path.exists() and not force:
        raise ConfigError(f"{path} exists already; choose another name, or --force to replace it")


def sha256(path: Path) -> str:
    """Hex digest of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def is_taken(directory: Path) -> bool:
    """True if the path exists and is no empty directory; a lock file in the directory does not count."""
    if not directory.is_dir():
        return directory.exists()
    return any(entry.name != LOCK for entry in directory.iterdir())


def unused(base: Path) -> Path:
    """That path, or if it is there the first of ``-2``, ``-3`` and so on that is not."""
    path, count = base, 1
    while path.exists():
        count += 1
        path = base.with_name(f"{base.name}-{count}")
    return path


def refuse_taken(directory: Path | str | None) -> None:
    """Refuse a directory for a new run, before anything else is done: a mistyped --out should fail at once.

    Raises:
        RunDirError: it exists and is not empty.
    """
    if directory is not None and is_taken(Path(directory)):
        raise RunDirError(
            f"--out {directory} exists and is not empty: nothing was changed; "
            f"choose another, or continue it with: apil resume {directory}"
        )


def locked_for(path: Path, command: str) -> AbstractContextManager[None]:
    """Hold a lock beside a file that ``command`` writes results to.

    Raises:
        ConfigError: another process holds it.
    """
    lock = path.with_name(f".{path.name}.lock")
    return locked(lock, f"{path}: another {command} is writing to it", ConfigError)


@contextmanager
def locked(
    file: Path, message: str, error: type[ApilError] = RunDirError, patience: float = 0.0
) -> Iterator[None]:
    """Hold ``file`` as a lock against other processes; a killed process releases it.

    Args:
        file: the lock; its directory exists.
        message: of the error.
        error: its type.
        patience: seconds to wait for another process.

    Raises:
        ApilError: another process still holds it.
    """
    from filelock import FileLock, Timeout

    lock = FileLock(file)
    try:
        lock.acquire(timeout=patience)
    except Timeout as reason:
        raise error(message) from reason
    try:
        yield
    finally:
        lock.release()
