"""Download of upstream's pickles at the pinned commit, for users without a copy of the repository."""

from __future__ import annotations

import logging
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from apil_core.common.errors import UnknownNameError, VictimError
from apil_core.policies import zoo_cache as cache
from apil_core.policies import zoo_catalogue as catalogue
from apil_core.policies.zoo_catalogue import ZooEntry
from apil_core.policies.zoo_import import ImportRow, ZooImportError, import_zoo

BASE_URL = "https://raw.githubusercontent.com/openai/multiagent-competition/{commit}/"
"""Default place of the files; ``{commit}`` is filled in."""


def download_zoo(games: Iterable[str] | None = None, base_url: str | None = None) -> list[ImportRow]:
    """Download the agents that the cache does not hold intact, then import them.

    Args:
        games: only those of these games (``None``: all).
        base_url: a mirror with upstream's layout below it; may contain ``{commit}``.

    Returns:
        one row per agent that was fetched; empty if all were there already.

    Raises:
        UnknownNameError: no such game in the zoo.
        ZooImportError: no network, or a file is missing or not what upstream published. Every
            other file that could be fetched is imported.
    """
    wanted = [entry for entry in _entries_of(games) if not _intact(entry)]
    if not wanted:
        return []
    base = (base_url or BASE_URL).replace("{commit}", wanted[0].commit).rstrip("/") + "/"
    urls = {entry.full_name: base + entry.file for entry in wanted}
    with tempfile.TemporaryDirectory(prefix="apil-zoo-") as folder:
        refused = _fetch(wanted, Path(folder), base)
        fetched = any((Path(folder) / entry.file).is_file() for entry in wanted)
        imported = import_zoo(folder) if fetched else []
    rows = [replace(row, source=urls[row.name]) for row in [*imported, *refused]]
    if refused:
        raise ZooImportError(rows)
    return rows


def _entries_of(games: Iterable[str] | None) -> list[ZooEntry]:
    chosen = set(catalogue.GAMES if games is None else games)
    for game in sorted(chosen - set(catalogue.GAMES)):
        raise UnknownNameError("game", game, catalogue.GAMES)
    return [entry for entry in catalogue.entries().values() if entry.game in chosen]


def _intact(entry: ZooEntry) -> bool:
    try:
        cache.read(entry)
    except VictimError:
        return False
    return True


def _fetch(wanted: list[ZooEntry], folder: Path, base: str) -> list[ImportRow]:
    """Put the files into ``folder`` in upstream's layout; returns a row for each that failed."""
    import pooch
    from requests.exceptions import RequestException

    registry = {entry.file: f"sha256:{entry.sha256}" for entry in wanted}
    store = pooch.create(path=folder, base_url=base, registry=registry)
    refused = []
    with _quiet(pooch.get_logger()):
        for entry in wanted:
            try:
                store.fetch(entry.file)
            # requests' errors are OSErrors, and a few are ValueErrors too: caught first
            except (RequestException, OSError) as error:
                refused.append(ImportRow(entry.full_name, "", "", _unreachable(base + entry.file, error)))
                if getattr(error, "response", None) is None:
                    break  # the server does not respond: the other files would time out too
            except ValueError as error:  # pooch's word for a wrong checksum
                reason = f"{entry.file}: {str(error).partition('. ')[0]}; not imported"
                refused.append(ImportRow(entry.full_name, "", "", reason))
    return refused


def _unreachable(url: str, error: Exception) -> str:
    response = getattr(error, "response", None)
    reason = type(error).__name__ if response is None else f"HTTP {response.status_code}"
    return (
        f"cannot download {url} ({reason}); without network, take a copy of upstream's agent-zoo "
        "and use `apil victims import DIR`"
    )


@contextmanager
def _quiet(logger: logging.Logger) -> Iterator[None]:
    """Silence pooch, which logs each file on stderr; the command line reports progress itself."""
    level = logger.level
    logger.setLevel(logging.WARNING)
    try:
        yield
    finally:
        logger.setLevel(level)
