"""Ctrl-C, SIGTERM and SIGHUP as requests: the running code stops at its next safe point."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from types import FrameType

from apil_core.evaluation.progress import Progress


@contextmanager
def on_stop_signal(asked: Callable[[], None]) -> Iterator[None]:
    """Call ``asked`` for each SIGINT, SIGTERM or SIGHUP in the ``with`` block, in the main thread only.

    A SIGHUP that the process was started to ignore (nohup) stays ignored.

    Args:
        asked: called in the main thread between any two bytecodes; its exceptions are raised there.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    terminals = [number for number in (1, 2) if os.isatty(number)]

    def handle(number: int, frame: FrameType | None) -> None:
        if number == signal.SIGHUP:
            for terminal in terminals:  # it is gone: to write there would be an error
                os.dup2(os.open(os.devnull, os.O_WRONLY), terminal)
        asked()

    numbers = [signal.SIGINT, signal.SIGTERM]
    if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
        numbers.append(signal.SIGHUP)
    previous = {number: signal.signal(number, handle) for number in numbers}
    try:
        yield
    finally:
        for number, old in previous.items():
            signal.signal(number, old)


class Stopped(Exception):  # noqa: N818  (no error: the user asked for it)
    """Ctrl-C during an evaluation."""


class StopRequest:
    """Counts signals: the first asks training to end after its iteration, the second ends it at once.

    Attributes:
        asked: whether a signal was received.
        progress: forwards an evaluation's progress, and interrupts it with :class:`Stopped` once asked.

    Args:
        progress: gets a note of the request, and the progress of evaluations.
    """

    def __init__(self, progress: Progress):
        self.asked = False
        self.progress: Progress = _StoppableProgress(self, progress)
        self._progress = progress

    def listening(self) -> AbstractContextManager[None]:
        """Handle signals within ``with``."""
        return on_stop_signal(self._ask)

    def _ask(self) -> None:
        if self.asked:
            raise KeyboardInterrupt
        self.asked = True
        with suppress(RuntimeError):  # the signal may have come in the middle of a print
            self._progress.note("stopping after this iteration, with a checkpoint (once more: at once)")


class _StoppableProgress(Progress):
    def __init__(self, request: StopRequest, progress: Progress):
        self._stop_request = request
        self._progress = progress

    def evaluation_progress(self, done: int, total: int) -> None:
        if self._stop_request.asked:
            raise Stopped
        self._progress.evaluation_progress(done, total)
