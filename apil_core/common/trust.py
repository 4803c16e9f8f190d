"""Trust in user code: code that a file names is refused until the user names it or has run it there.

``python:`` and ``pettingzoo:`` names and one-file plugins are code. A name from a config, a matrix or a run
directory (:func:`named_in`) is refused by :func:`check`, unless it is on the command line, the command line
has ``--trust``, or the user's record says that it ran from the same directory before.
"""

from __future__ import annotations

import json
import os
import re
import sys
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import platformdirs

from apil_core.common.errors import ApilError, ConfigError
from apil_core.common.visible import visible

FLAG = "--trust"
_RECORD = "code-that-ran.jsonl"
_trusted: set[str] = set()
"""Arguments of the command line, and names given to :func:`trust`; :data:`FLAG` trusts all."""
_named: dict[str, set[Path]] = defaultdict(set)
"""Name → files that contain it."""
_ran: set[str] = set()
"""Names of all code loaded so far."""


def begin(arguments: Sequence[str]) -> list[str]:
    """Reset the state and trust what the command line names; returns the command line without ``--trust``."""
    for known in (_trusted, _named, _ran):
        known.clear()
    trust(*(word for text in arguments for word in (text, *re.split(r"[=,\[\]'\" ]+", text))))
    return [text for text in arguments if text != FLAG]


def trust(*names: str) -> None:
    """Allow code that files name to run in this process.

    Args:
        names: ``python:`` and ``pettingzoo:`` names, paths of one-file plugins; ``"--trust"``: all.
    """
    _trusted.update(str(Path(name).resolve()) if name.endswith(".py") else name for name in names)


def named_in(file: Path, data: Any) -> None:
    """Record all names in the contents of ``file``; a ``trust: true`` beside them has no effect."""
    for text in _texts(data):
        if ":" in text or "/" in text:
            _named[text].add(file)


def check(name: str, trusted: bool = True, error: type[ApilError] = ConfigError) -> None:
    """Check that code of that name may be loaded; prints once on stderr what is loaded and who named it.

    Args:
        name: a policy's, a game's, or the absolute path of a one-file plugin.
        trusted: by the calling Python code; ignored if a file names it.
        error: what to raise.

    Raises:
        ApilError: it is not trusted.
    """
    files = sorted(map(str, _named[name])) if name in _named else []
    where = files[0] if files else "no file"
    if _trusted & {name, FLAG} or (trusted and not files):
        why = "as asked"
    elif _record() & {(str(Path(file).parent.resolve()), name) for file in files}:
        why = "run there before"
    else:
        raise error(
            f"{name} runs code when it is loaded, and {where} names it: name it on the command line, or "
            f"add {FLAG} if you trust that (once also for your runs older than this check; "
            "Python: apil_core.trust)"
        )
    if files and name not in _ran and os.environ.get("RANK", "0") == "0":
        print(visible(f"apil: loads code: {name}, named by {where} ({why})"), file=sys.stderr)
    _ran.add(name)


def remember(directory: Path) -> None:
    """Record that the user ran the code loaded so far from ``directory``, so that it may run there again."""
    ran = {(str(directory.resolve()), name) for name in _ran}
    new = [json.dumps(line) + "\n" for line in sorted(ran - _record())] if ran else []
    if new:
        with suppress(OSError):  # the home directory is not writable: --trust is needed again next time
            _path().parent.mkdir(parents=True, exist_ok=True)
            with _path().open("a", encoding="utf-8") as file:
                file.write("".join(new))


def _record() -> set[tuple[str, str]]:
    """Directory and name of all code in the record."""
    found = set()
    with suppress(OSError):
        for line in _path().read_text("utf-8", errors="replace").splitlines():
            with suppress(ValueError):
                directory, name = json.loads(line)
                found.add((str(directory), str(name)))
    return found


def _path() -> Path:
    return platformdirs.user_state_path("apil") / _RECORD


def _texts(data: Any) -> Iterator[str]:
    if isinstance(data, str):
        yield data
    elif isinstance(data, Mapping):
        for key, value in data.items():
            yield from (*_texts(key), *_texts(value))
    elif isinstance(data, (list, tuple)):
        for item in data:
            yield from _texts(item)
