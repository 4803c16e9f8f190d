"""Errors a user can cause or fix. The command line prints them as one line, without a traceback."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class ApilError(Exception):
    """A user's mistake or a missing file or package; the message states what, where, and the remedy."""

    exit_code = 2


class ConfigError(ApilError):
    """A key or value in a config file, preset or ``--set`` is wrong."""


class UnknownNameError(ApilError):
    """A method, game, victim, hook or preset of that name does not exist."""

    def __init__(self, kind: str, name: str, known: Iterable[str]):
        super().__init__(f"unknown {kind} {name!r}{suggest(name, known)}")


class PluginError(ApilError):
    """A plugin is broken; the message names it."""


class VictimError(ApilError):
    """A victim's weights are missing, damaged or not the expected ones."""


class RunDirError(ApilError):
    """A run directory or checkpoint cannot be read, written or continued."""


def failures() -> tuple[type[BaseException], ...]:
    """Exceptions of failing third-party code, for ``except``: all that there are but Ctrl-C's.

    ``sys.exit(0)`` in it must not end this process with success, and its own kinds of ``BaseException`` are
    failures as well.
    """
    return tuple({*BaseException.__subclasses__()} - {KeyboardInterrupt, GeneratorExit})


_REASON = 300
"""Maximum number of characters shown of a third-party error."""


def reason_of(error: BaseException) -> str:
    """Type and text of a third-party exception, on one line; the middle of a long one is cut.

    TorchScript and onnxruntime begin with the location, and end with the error.
    """
    text = " ".join(str(error).split())
    if len(text) > _REASON:
        text = f"{text[: _REASON // 3]} … {text[-2 * _REASON // 3 :]}"
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def suggest(name: str, known: Iterable[str]) -> str:
    """``" (did you mean 'x'?; known: ...)"`` for an unknown ``name`` among ``known``."""
    names = sorted(known)
    close = difflib.get_close_matches(name, names, n=1)
    listing = ", ".join(names) if names else "none"
    return f" (did you mean {close[0]!r}? known: {listing})" if close else f" (known: {listing})"
