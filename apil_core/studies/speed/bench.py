"""All settings, one after the other; whatever stops it, finished ones are kept."""

from __future__ import annotations

import gc
import os
from collections.abc import Callable, Sequence
from datetime import UTC, datetime

from apil_core.plugins.discovery import PluginRegistry
from apil_core.studies.speed.cell import CellBench
from apil_core.studies.speed.machine import this_machine
from apil_core.studies.speed.plan import CellPlan
from apil_core.studies.speed.report import SpeedReport


class SpeedWatch:
    """Hears how the measurement goes. Base and silent default."""

    def stage(self, index: int, plan: CellPlan, text: str, share: float) -> None:
        """Cell ``index`` does ``text``; ``share`` of its time is over."""

    def cell(self, index: int, report: SpeedReport) -> None:
        """Cell ``index`` is measured; the report holds it."""


def measure(
    cells: Sequence[CellPlan],
    plugins: PluginRegistry,
    *,
    command: Sequence[str],
    watch: SpeedWatch,
    keep: Callable[[SpeedReport], None],
) -> SpeedReport:
    """Measure every cell. Ctrl-C ends it: the report then says so, and holds the finished cells.

    Args:
        cells: from :func:`apil_core.studies.speed.plan.make_plan`.
        plugins: to build from.
        command: what is kept as the way to get this report.
        watch: hears how it goes.
        keep: called with the report after each cell.

    Raises:
        ApilError: a cell cannot be built or run; ``keep`` has got those before it.
    """
    started = datetime.now(UTC).isoformat(timespec="seconds")
    report = SpeedReport(command=list(command), started=started, machine=this_machine())
    for i, plan in enumerate(cells):
        try:
            _add(report, i, plan, plugins, watch)
        except KeyboardInterrupt:
            report.interrupted = True
            break
        keep(report)
        watch.cell(i, report)
    return report


def _add(report: SpeedReport, i: int, plan: CellPlan, plugins: PluginRegistry, watch: SpeedWatch) -> None:
    gc.collect()  # the last cell's trainings refer to themselves in circles
    bench = CellBench(plan, plugins, lambda text, share: watch.stage(i, plan, text, share))
    blocks, cell = bench.measure()
    report.cells.append(cell)
    report.rows += blocks.rows()
    report.hooks += blocks.hooks()
    report.machine.load_after = os.getloadavg()[0]
