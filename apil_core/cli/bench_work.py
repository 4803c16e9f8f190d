"""``apil bench work``: the entry point of the worker processes of ``apil bench run``; not for users."""

from __future__ import annotations

import os
import signal
import sys
import threading
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from apil_core.cli.guard import INTERRUPTED


def work(
    root: Annotated[Path, Parameter(name="DIR", help="The benchmark's directory.")],
    job: Annotated[str, Parameter(name="JOB", help="Name of the job.")],
    /,
    *,
    threads: Annotated[int, Parameter(help="Physics threads; never changes results.")] = 1,
    supervised: Annotated[
        bool, Parameter(show_default=False, help="Stop with a checkpoint when standard input closes.")
    ] = False,
) -> int:
    """Do the remaining work of one job of a benchmark."""
    from apil_core.cli.progress import PlainProgress
    from apil_core.studies.bench.work import perform

    if supervised:
        follow_supervisor()
    progress = PlainProgress()
    return 0 if perform(root, job, threads=threads, progress=progress) == "done" else INTERRUPTED


def follow_supervisor() -> None:
    """Stop as for Ctrl-C when standard input closes: the supervisor is gone, or wants it."""
    # SIGINT may be inherited blocked (from Ray) or ignored (from nohup)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    signal.signal(signal.SIGINT, signal.default_int_handler)
    threading.Thread(target=_wait_for_the_end, daemon=True).start()


def _wait_for_the_end() -> None:
    while os.read(sys.stdin.fileno(), 4096):  # unbuffered: a buffer's lock would be held when we exit
        pass
    os.kill(os.getpid(), signal.SIGINT)
