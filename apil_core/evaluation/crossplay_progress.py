"""Many evaluations told as one."""

from __future__ import annotations

from apil_core.evaluation.progress import Progress


class PartOfAll(Progress):
    """Games of one pairing counted among those of all; nothing else is passed on.

    Args:
        progress: told of all games.
        before: games of the pairings before.
        total: games of all.
    """

    def __init__(self, progress: Progress, before: int, total: int):
        self._progress, self._before, self._total = progress, before, total

    def evaluation_progress(self, done: int, total: int) -> None:
        """See :meth:`apil_core.evaluation.progress.Progress.evaluation_progress`."""
        self._progress.evaluation_progress(self._before + done, self._total)
