"""Rows of a run's log: one per iteration or, in runs of very many iterations, one for every k of them.

Rows have the same meaning at any k: curves, listings and TensorBoard read merged rows like single ones.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, Protocol

from apil_core.api.config import RunConfig
from apil_core.api.specs import RecorderSpec, load
from apil_core.common.errors import failures

Row = dict[str, float]

_SUMMED = {"games", "row_steps"}
_LAST = {"iteration", "steps", "total_steps", "wall_seconds", "memory_mb"}
_LAST_PREFIXES = ("opponent/", "window_", "evaluation/")
_PER_GAME = ("return/", "episode_length")


class Recorder(Protocol):
    """A sink for metrics, see ``register_recorders``.

    Optional members: ``summarize(scores)``, which gets the final scores (``final/win`` etc.), and
    ``dispensable = True``: if it fails, the run continues without it.
    """

    def record(self, metrics: Mapping[str, float]) -> None:
        """Record one row."""

    def close(self) -> None:
        """Finish; no row follows."""


def open_recorders(specs: Iterable[RecorderSpec], run_dir: Path) -> list[Recorder]:
    """Open the recorders of a run; if one fails, those before it are closed."""
    with ExitStack() as stack:
        opened: list[Recorder] = []
        for spec in specs:
            opened.append(load(spec.factory)(run_dir))
            stack.callback(opened[-1].close)
        stack.pop_all()
    return opened


def iterations_per_row(config: RunConfig) -> int:
    """The least k at which the planned iterations make no more than ``config.log_rows`` rows."""
    planned = math.ceil(config.steps / config.rollout_steps)
    return math.ceil(planned / config.log_rows)


class RowLog:
    """Merges iterations into rows and passes these to the recorders.

    A row ends with every k-th iteration, counted from the run's first, and with every evaluation, so that a
    score is logged at its own steps. Rows therefore depend only on the run's history, not on when it was
    stopped: :attr:`pending` is stored in the checkpoint, and a row cut short by the end of a session is
    written again, in full, on resume (see :func:`iterations_in_rows`).

    Args:
        recorders: that receive the rows.
        every: k, at least 1. At 1 rows are the iterations' metrics, unchanged.
        pending: metrics of iterations that are in no row yet, from a checkpoint.
        note: called with one line when a dispensable recorder fails.

    Attributes:
        pending: as the argument, current; each with its number of environment steps as ``row_steps``.
    """

    def __init__(
        self,
        recorders: Sequence[Recorder],
        every: int,
        pending: Iterable[Row] = (),
        note: Callable[[str], None] = lambda text: None,
    ):
        self.recorders = list(recorders)
        self.every = every
        self.pending = list(pending)
        self._note = note
        self._failed = False

    def record(self, metrics: Mapping[str, float], steps: int) -> None:
        """Add one iteration and its number of environment steps; it stays pending if a recorder fails."""
        self.pending.append({**metrics, "row_steps": steps})
        evaluated = any(name.startswith("evaluation/") for name in metrics)
        if evaluated or int(metrics["iteration"]) % self.every == 0:
            self._write()

    def summarize(self, scores: Mapping[str, float]) -> None:
        """Write pending iterations, and pass the final scores to recorders with ``summarize``."""
        if self.pending:
            self._write()
        for recorder in self.recorders.copy():
            summarize = getattr(recorder, "summarize", None)
            if summarize is not None:
                self._ask(recorder, summarize, scores)

    def close(self) -> None:
        """Write pending iterations, and close the recorders; failures are noted, and lose no result."""
        try:
            if self.pending and not self._failed:
                self._write()
        except failures() as error:
            self._note(f"the log lacks its last row: {' '.join(str(error).split()) or type(error).__name__}")
        for recorder in self.recorders:
            try:
                recorder.close()
            except failures() as error:
                self._tell_of(recorder, error, "")

    def _write(self) -> None:
        row = merged(self.pending)
        self._failed = True  # some recorders may have the row already: they must not get it twice
        for recorder in self.recorders.copy():
            self._ask(recorder, recorder.record, row)
        self._failed = False
        self.pending = []

    def _ask(
        self, recorder: Recorder, method: Callable[[Mapping[str, float]], None], row: Mapping[str, float]
    ) -> None:
        """Call one of a recorder's methods; a dispensable one that fails is not called again."""
        try:
            method(dict(row))  # a copy: a recorder may modify it
        except failures() as error:
            if not getattr(recorder, "dispensable", False):
                raise
            self.recorders.remove(recorder)
            self._tell_of(recorder, error, "; the run goes on without it")
            with suppress(*failures()):  # it may fail again
                recorder.close()

    def _tell_of(self, recorder: Recorder, error: BaseException, consequence: str) -> None:
        name = getattr(recorder, "name", type(recorder).__name__)
        reason = " ".join(f"{error}".split()) or type(error).__name__
        self._note(f"recorder {name} failed: {reason}{consequence}")


def iterations_in_rows(state: Mapping[str, Any]) -> int:
    """The last iteration whose row was complete when a checkpoint's ``state`` was taken."""
    return int(state["iteration"]) - len(state.get("pending_rows", ()))


def merged(rows: Sequence[Row]) -> Row:
    """One row for consecutive iterations.

    Numbers of games and of endings are summed. What is a total or a state (steps, seconds, memory,
    ``window_*``, ``opponent/*``, ``*_total``, evaluations) is the last one's. All else is a mean over the
    iterations that have it as a finite number: of returns and lengths weighted by games, of
    ``steps_per_second`` by seconds, of the rest by steps. Merged rows have ``row_iterations`` and
    ``row_steps``, their extent; a single one is returned unchanged, without ``row_steps``.

    Args:
        rows: metrics in order, at least one, each with its ``row_steps``.
    """
    if len(rows) == 1:
        return {name: value for name, value in rows[0].items() if name != "row_steps"}
    names = dict.fromkeys(name for row in rows for name in row)  # in order of appearance
    return {name: _value(name, [row for row in rows if name in row]) for name in names} | {
        "row_iterations": len(rows)
    }


def over_processes(rows: Sequence[Mapping[str, float]]) -> Row:
    """One row for an iteration of several processes, from one row of each.

    Counts of games are added, means over ended games weighted by their number, all others averaged where they
    are finite.
    """

    def value(name: str, rows: Sequence[Mapping[str, float]]) -> float:
        if name in ("games", "games_total") or name.startswith(("window_", "cause/")):
            return sum(row[name] for row in rows)
        per_game = name.startswith(_PER_GAME)
        return _mean([(row[name], row["games"] if per_game else 1.0) for row in rows])

    names = dict.fromkeys(name for row in rows for name in row)
    return {name: value(name, [row for row in rows if name in row]) for name in names}


def _value(name: str, rows: Sequence[Row]) -> float:
    if name in _SUMMED or name.startswith("cause/"):
        return sum(row[name] for row in rows)
    if name in _LAST or name.endswith("_total") or name.startswith(_LAST_PREFIXES):
        return rows[-1][name]
    return _mean([(row[name], _weight(name, row)) for row in rows])


def _weight(name: str, row: Row) -> float:
    if name.startswith(_PER_GAME):
        return row["games"]
    if name == "steps_per_second":
        return row["collect_seconds"] + row["update_seconds"]
    return row["row_steps"]


def _mean(values: Sequence[tuple[float, float]]) -> float:
    """Weighted mean of (value, weight) pairs with a finite value; NaN if there is none."""
    finite = [(value, weight) for value, weight in values if math.isfinite(value)]
    total = sum(weight for _, weight in finite)
    return sum(value * weight for value, weight in finite) / total if total > 0 else math.nan
