"""Turn exceptions into one line on stderr and an exit code."""

from __future__ import annotations

import errno
import os
import re
import sys
import tempfile
import threading
import time
import traceback
from contextlib import suppress
from io import TextIOWrapper
from pathlib import Path
from typing import TYPE_CHECKING

from apil_core.cli.output import say
from apil_core.common.errors import ApilError, ConfigError, failures
from apil_core.common.extras import missing
from apil_core.common.trust import begin
from apil_core.training.distributed.world import World

if TYPE_CHECKING:
    from cyclopts import CycloptsError

USAGE_ERROR = 2
INTERNAL_ERROR = 1
INTERRUPTED = 130
_HOME = re.compile(r"^(--[\w-]+=|)~(?=/|$)")
_PLACES = {
    *(errno.ENAMETOOLONG, errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EACCES, errno.EPERM),
    *(
        errno.ENOENT,
        errno.ENOTDIR,
        errno.EISDIR,
        errno.ELOOP,
        errno.EIO,
        errno.EMFILE,
        errno.ENODEV,
        errno.ESTALE,
    ),
}
"""Numbers of system errors that a place has: the user can mend them, no code."""
_MEMORY = ("an't allocate memory", "annot allocate memory", "failed to map segment", "CUDA out of memory")
"""Texts of errors of libraries that get no memory."""
_COURTESY = 3.0
"""Seconds that other processes wait for the first one's message."""


def guarded(arguments: list[str]) -> int:
    """Run the command line; return the exit code, never raise."""
    from cyclopts import CycloptsError

    from apil_core.cli.app import make_app

    _make_streams_usable()
    threading.excepthook = _in_thread
    try:
        os.getcwd()  # libraries end the program without one
        # the shell leaves the ~ of --out=~/runs as it is
        result = make_app()(begin([_HOME.sub(_expanded, text) for text in arguments]))
        sys.stdout.flush()
    except ApilError as error:
        if os.environ.get("APIL_DEBUG") == "1":  # for mistakes in code of the user's
            traceback.print_exception(error)
        return complain(str(error), error.exit_code)
    except CycloptsError as error:
        return complain(f"{_one_line(str(error))} (see: {_help_of(error)})", USAGE_ERROR)
    except KeyboardInterrupt:
        return complain("interrupted", INTERRUPTED)
    except BrokenPipeError:  # `apil … | head`: the reader has closed the pipe
        _give_up_stdout()
        return 0
    except ModuleNotFoundError as error:
        absent = missing(error.name)
        return complain(str(absent), absent.exit_code) if absent else _report(error)
    except OSError as error:
        if error.errno not in _PLACES or os.environ.get("APIL_DEBUG") == "1":
            return _report(error)
        return complain(_of_place(error), USAGE_ERROR)
    except SystemExit as error:  # raised by a plugin or a game, and not caught closer to it
        last = traceback.extract_tb(error.__traceback__)[-1]
        if last.name == "on_broken_pipe":  # rich's way to end where the reader has closed the pipe
            return 0
        text = f"{last.filename}, line {last.lineno}: code that a run uses ended the program (exit {error})"
        return complain(text, INTERNAL_ERROR)
    except failures() as error:
        return _report(error)
    return result if isinstance(result, int) else 0


def _make_streams_usable() -> None:
    """Where output is closed it goes nowhere; letters that its encoding lacks become question marks."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, Path(os.devnull).open("w", encoding="utf-8"))  # noqa: SIM115
        elif isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="replace")


def _in_thread(failure: threading.ExceptHookArgs) -> None:
    """A writer's full disk or missing directory is raised again where it is used; print all else."""
    if not issubclass(failure.exc_type, OSError) or os.environ.get("APIL_DEBUG") == "1":
        threading.__excepthook__(failure)


def _expanded(found: re.Match[str]) -> str:
    return found[1] + os.path.expanduser("~")


def _of_place(error: OSError) -> str:
    """What is wrong with a file, a directory or standard output."""
    if error.filename:
        return f"{os.fsdecode(error.filename)}: {error.strerror}"
    if error.errno == errno.ENOENT:
        return "the current directory is gone: change to one that is there"
    with suppress(OSError):
        sys.stdout.flush()
        return str(error.strerror)
    _give_up_stdout()
    return f"output: {error.strerror}"


def _give_up_stdout() -> None:
    """Let nothing more be written there, lest Python complains when it ends."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def complain(message: str, code: int) -> int:
    """Print ``apil: message`` on stderr, each of several mistakes on its own line."""
    who = _in_turn()
    for line in message.splitlines() or ["unknown error"]:
        say(f"apil: {who}{line}")
    return code


def _in_turn() -> str:
    """Return the prefix of this process's messages; wait first unless it is the first process.

    Most errors occur in all processes; torchrun ends the others as soon as one has failed, so the wait
    leaves one message, the first process's.
    """
    try:
        rank = World.here().rank
    except ConfigError:
        return ""
    if rank == 0:
        return ""
    time.sleep(_COURTESY)
    return f"rank {rank}: "


def _report(error: BaseException) -> int:
    if isinstance(error, MemoryError) or any(words in str(error) for words in _MEMORY):
        said = f" ({_one_line(str(error))[:200]})" if str(error) else ""
        return complain(f"memory is too small{said}: fewer --num-envs, a smaller ppo.num_steps", USAGE_ERROR)
    if os.environ.get("APIL_DEBUG") == "1":
        traceback.print_exception(error)
        return INTERNAL_ERROR
    summary = f"unexpected {type(error).__name__}: {_one_line(str(error))}"
    try:
        handle, path = tempfile.mkstemp(prefix="apil-traceback-", suffix=".txt")
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            traceback.print_exception(error, file=file)
    except OSError:
        return complain(f"{summary} (APIL_DEBUG=1 shows the traceback)", INTERNAL_ERROR)
    return complain(f"{summary} (traceback: {path})", INTERNAL_ERROR)


def _one_line(text: str) -> str:
    return " ".join(text.split()) or "no message"


def _help_of(error: CycloptsError) -> str:
    """Return the help of the innermost command that was recognised."""
    return " ".join(["apil", *(error.command_chain or ()), "--help"])
