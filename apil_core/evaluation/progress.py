"""Progress of runs and evaluations: callbacks. The command line has a live view; the default is silent."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from apil_core.api.config import RunConfig
    from apil_core.evaluation.results import EvaluationResult


class Progress:
    """Base class and silent default: override the callbacks to show.

    ``metrics`` of :meth:`iteration`: docs/metrics.md.
    """

    def started(self, config: RunConfig, run_dir: Path, victim: str, steps_done: int) -> None:
        """The run is built and starts (or resumes at ``steps_done``)."""

    def iteration(self, metrics: dict[str, float]) -> None:
        """An iteration ended."""

    def evaluation_progress(self, done: int, total: int) -> None:
        """``done`` of ``total`` games of an evaluation have ended."""

    def evaluation(self, result: EvaluationResult, steps: int) -> None:
        """An evaluation ended, after ``steps`` steps of training."""

    def note(self, text: str) -> None:
        """A one-line note for the user."""

    def finished(self, run_dir: Path) -> None:
        """The run is over (finished or interrupted)."""


class PartOfAll(Progress):
    """Counts the games of one pairing among those of all; forwards nothing else.

    Args:
        progress: gets the count over all games.
        before: games of the pairings before.
        total: games of all.
    """

    def __init__(self, progress: Progress, before: int, total: int):
        self._progress, self._before, self._total = progress, before, total

    def evaluation_progress(self, done: int, total: int) -> None:
        """See :meth:`apil_core.evaluation.progress.Progress.evaluation_progress`."""
        self._progress.evaluation_progress(self._before + done, self._total)
