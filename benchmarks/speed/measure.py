"""Measure settings in rounds: every level is measured in turn, seconds apart and on the same games."""

from __future__ import annotations

import gc
import os
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack, closing
from datetime import UTC, datetime

from apil_core.api.game import PhysicsStopwatch
from apil_core.common.machine import resident_mb
from apil_core.common.torch_threads import one_torch_thread
from apil_core.plugins.discovery import PluginRegistry

from .blocks import Blocks, Lap
from .machine import PeakMemory, this_machine
from .plan import CellPlan
from .replay import Replay
from .report import Cell, Level, Setting, SpeedReport
from .training import TimedTraining

WARM_UP = 1
"""Untimed iterations: libraries initialise, robots come down to the floor."""

LEAST_ROUNDS = 3
"""Fewest rounds, however long they take: quartiles need them."""

Measured = dict[Level, tuple[float, float]]
"""Seconds and peak memory in MB by level."""


def measure(
    cells: Sequence[CellPlan],
    plugins: PluginRegistry,
    *,
    command: Sequence[str],
    say: Callable[[str], None],
    keep: Callable[[SpeedReport], None],
) -> SpeedReport:
    """Measure every cell. Ctrl-C ends it: the report records that, and holds the finished cells.

    Args:
        cells: from :func:`.plan.make_plan`.
        plugins: to build from.
        command: stored in the report for reproducibility.
        say: called with lines of progress.
        keep: called with the report after each cell.

    Raises:
        ApilError: a cell cannot be built or run; ``keep`` has got those before it.
    """
    started = datetime.now(UTC).isoformat(timespec="seconds")
    report = SpeedReport(command=list(command), started=started, machine=this_machine())
    for i, plan in enumerate(cells, 1):
        say(f"{i} of {len(cells)}: {plan}")
        gc.collect()  # the last cell's trainings have reference cycles
        try:
            blocks, cell = CellBench(plan, plugins).measure()
        except KeyboardInterrupt:
            report.interrupted = True
            break
        report.cells.append(cell)
        report.rows += blocks.rows()
        report.hooks += blocks.hooks()
        report.machine.load_after = os.getloadavg()[0]
        keep(report)
        say(f"{i} of {len(cells)}: {cell.rounds} rounds in {cell.wall_seconds:.0f} s")
    return report


class CellBench:
    """Measures one setting.

    Args:
        plan: the setting.
        plugins: to build from.
    """

    def __init__(self, plan: CellPlan, plugins: PluginRegistry):
        self._plan = plan
        self._plugins = plugins
        self._begin = time.perf_counter()
        self._memory = PeakMemory()
        self._same_games = True

    def measure(self) -> tuple[Blocks, Cell]:
        """Build everything, warm up, and measure rounds until the time is up.

        Raises:
            ApilError: something in it does not work.
        """
        before = resident_mb()
        with ExitStack() as stack, one_torch_thread():
            entries = {method: self._entry(method, stack) for method in self._plan.configs}
            training, stopwatch = next(iter(entries.values()))
            replay = stack.enter_context(closing(Replay(training.attack, self._plugins)))
            base: Level = "game" if stopwatch is None else "physics"
            blocks = Blocks(_setting(training), self._plan.levels, base)
            rounds = self._go_round(blocks, entries, replay)
            after = resident_mb()
        return blocks, Cell(
            **blocks.setting.model_dump(),
            rounds=rounds,
            warm_up=WARM_UP,
            wall_seconds=self._elapsed,
            same_games=self._same_games,
            resident_before_mb=before,
            resident_after_mb=after,
            peak_mb=self._memory.largest,
            peak_exact=self._memory.exact,
        )

    @property
    def _elapsed(self) -> float:
        return time.perf_counter() - self._begin

    def _entry(self, method: str, stack: ExitStack) -> tuple[TimedTraining, PhysicsStopwatch | None]:
        """A method's training, warmed up, and the timer of its physics if that can be timed alone."""
        training = stack.enter_context(closing(TimedTraining(self._plan.configs[method], self._plugins)))
        for _ in range(WARM_UP):
            training.iterate()
        stopwatch = training.attack.game.physics_stopwatch()
        if stopwatch is not None:
            stack.enter_context(closing(stopwatch))
        return training, stopwatch

    def _go_round(
        self,
        blocks: Blocks,
        entries: dict[str, tuple[TimedTraining, PhysicsStopwatch | None]],
        replay: Replay,
    ) -> int:
        """Measure rounds as long as another one fits into the time; return how many."""
        rounds, last = 0, 0.0
        while rounds < LEAST_ROUNDS or self._elapsed + last <= self._plan.seconds:
            rounds, begin = rounds + 1, time.perf_counter()
            base = 0.0  # without a stopwatch it is the first method's games in this round
            for i, (method, entry) in enumerate(entries.items()):
                levels, lap = self._turn(*entry, replay if i == 0 else None)
                base, _ = levels.get(blocks.base, (base, 0.0))
                blocks.add(method, levels, base, lap)
            last = time.perf_counter() - begin
        return rounds

    def _turn(
        self, training: TimedTraining, stopwatch: PhysicsStopwatch | None, replay: Replay | None
    ) -> tuple[Measured, Lap]:
        """Measure every level of a method, and its games without it if ``replay`` is given.

        The iteration's physics is recorded during it; the time of recording is not counted.
        """
        hooks, start = training.timed_hooks, training.start()
        calls, dispatch = hooks.calls, hooks.seconds
        self._memory.take()
        if stopwatch:
            stopwatch.record()
        collect, whole = training.iterate()
        recording = stopwatch.stop() if stopwatch else 0.0
        memory = self._memory.take()
        levels: Measured = {
            "collection": (collect - recording, memory),
            "training": (whole - recording, memory),
        }
        lap = Lap(whole - recording, hooks.seconds - dispatch, hooks.calls - calls)
        if stopwatch:
            levels["physics"] = self._watched(stopwatch.replay)
        if replay:
            rollout = hooks.tape.rollout
            levels["game"] = self._watched(lambda: replay.play(start, rollout))
            self._same_games &= replay.arrived
            levels["victim"] = self._watched(lambda: replay.play_victim(start, rollout))
            self._same_games &= replay.arrived
        return levels, lap

    def _watched(self, work: Callable[[], float]) -> tuple[float, float]:
        """Return the seconds that ``work`` reports, and the peak memory meanwhile."""
        self._memory.take()
        seconds = work()
        return seconds, self._memory.take()


def _setting(training: TimedTraining) -> Setting:
    config = training.attack.config
    return Setting(
        env=config.env,
        physics=str(training.attack.game.settings.get("physics", "")),
        victim=config.victim,
        num_envs=config.num_envs,
        threads=config.threads,
        num_steps=config.ppo.num_steps,
    )
