"""Measuring one setting: rounds in which every level has its turn, seconds apart and on the same games."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import ExitStack, closing
from dataclasses import dataclass

from apil_core.api.game import PhysicsStopwatch
from apil_core.common.machine import resident_mb
from apil_core.common.torch_threads import one_torch_thread
from apil_core.plugins.discovery import PluginRegistry
from apil_core.studies.speed.blocks import Blocks, Lap
from apil_core.studies.speed.contestant import Contestant, Start
from apil_core.studies.speed.hooks import DirectHooks, TimedHooks
from apil_core.studies.speed.peak import PeakMemory
from apil_core.studies.speed.plan import CellPlan
from apil_core.studies.speed.replay import Replay
from apil_core.studies.speed.report import Cell, Level, Setting

WARM_UP = 1
"""Iterations before the clock counts: libraries set themselves up, robots come down to the floor."""

LEAST_ROUNDS = 3
"""Whatever the time they take: quartiles of fewer say nothing."""

Tell = Callable[[str, float], None]
"""Hears what is going on, and which share of the cell's time is over."""


@dataclass
class Entry:
    """A method's trainings.

    Attributes:
        timed: with the real hooks.
        stopwatch: of its physics, if that can be timed alone.
        direct: the same training with direct calls, if that is measured.
    """

    timed: Contestant
    stopwatch: PhysicsStopwatch | None
    direct: Contestant | None


@dataclass
class Turn:
    """What one method's turn in a round gave: seconds and largest memory by level, and what hooks did."""

    levels: dict[Level, tuple[float, float]]
    lap: Lap


class CellBench:
    """One setting.

    Args:
        plan: the setting.
        plugins: to build from.
        tell: hears what is going on.
    """

    def __init__(self, plan: CellPlan, plugins: PluginRegistry, tell: Tell):
        self._plan = plan
        self._plugins = plugins
        self._tell = tell
        self._begin = time.perf_counter()
        self._memory = PeakMemory()
        self._same_games = True

    def measure(self) -> tuple[Blocks, Cell]:
        """Build everything, warm up, and go round until the time is over.

        Raises:
            ApilError: something in it does not work.
        """
        before = resident_mb()
        with ExitStack() as stack, one_torch_thread():
            entries = {method: self._entry(method, stack) for method in self._plan.configs}
            first = next(iter(entries.values()))
            replay = stack.enter_context(closing(Replay(first.timed.attack, self._plugins)))
            base: Level = "game" if first.stopwatch is None else "physics"
            blocks = Blocks(_setting(first.timed), self._plan.levels, base)
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

    def _say(self, text: str) -> None:
        self._tell(text, min(self._elapsed / self._plan.seconds, 1.0))

    def _entry(self, method: str, stack: ExitStack) -> Entry:
        """A method's trainings, warmed up."""
        config = self._plan.configs[method]
        self._say(f"building and warming up {method}")
        timed = stack.enter_context(closing(Contestant(config, self._plugins, TimedHooks)))
        for _ in range(WARM_UP):
            timed.iterate()
        stopwatch = timed.attack.game.physics_stopwatch()
        if stopwatch is not None:
            stack.enter_context(closing(stopwatch))
        if "direct" not in self._plan.levels:
            return Entry(timed, stopwatch, None)
        direct = stack.enter_context(closing(Contestant(config, self._plugins, DirectHooks)))
        direct.follow(timed)
        return Entry(timed, stopwatch, direct)

    def _go_round(self, blocks: Blocks, entries: dict[str, Entry], replay: Replay) -> int:
        """Rounds as long as another one fits into the time; returns how many."""
        rounds, last = 0, 0.0
        while rounds < LEAST_ROUNDS or self._elapsed + last <= self._plan.seconds:
            rounds, begin = rounds + 1, time.perf_counter()
            base = 0.0  # without a stopwatch it is the first method's games in this round
            for i, (method, entry) in enumerate(entries.items()):
                self._say(f"round {rounds}, {method}")
                turn = self._turn(entry, replay if i == 0 else None, direct_first=rounds % 2 == 0)
                base, _ = turn.levels.get(blocks.base, (base, 0.0))
                blocks.add(method, turn.levels, base)
                blocks.laps[method].append(turn.lap)
            last = time.perf_counter() - begin
        return rounds

    def _turn(self, entry: Entry, replay: Replay | None, *, direct_first: bool) -> Turn:
        """Every level of a method, and that of its games without it if ``replay`` is given.

        Direct calls go first in each second round, so that the order evens out.
        """
        levels: dict[Level, tuple[float, float]] = {}
        if entry.direct and direct_first:
            levels["direct"] = self._watched(entry.direct.whole)
        start = entry.timed.start()
        lap = self._iterate(entry, levels)
        if entry.stopwatch:
            levels["physics"] = self._watched(entry.stopwatch.replay)
        if replay:
            self._replay(replay, start, entry.timed, levels)
        if entry.direct and not direct_first:
            levels["direct"] = self._watched(entry.direct.whole)
        if entry.direct:
            lap.direct, _ = levels["direct"]
        return Turn(levels, lap)

    def _iterate(self, entry: Entry, levels: dict[Level, tuple[float, float]]) -> Lap:
        """A whole iteration with its physics recorded; what recording took does not count."""
        hooks = entry.timed.timed_hooks
        calls, dispatch = hooks.calls, hooks.seconds
        self._memory.take()
        if entry.stopwatch:
            entry.stopwatch.record()
        collect, whole = entry.timed.iterate()
        recording = entry.stopwatch.stop() if entry.stopwatch else 0.0
        memory = self._memory.take()
        levels["collection"] = collect - recording, memory
        levels["training"] = whole - recording, memory
        return Lap(whole - recording, hooks.seconds - dispatch, hooks.calls - calls)

    def _replay(
        self, replay: Replay, start: Start, timed: Contestant, levels: dict[Level, tuple[float, float]]
    ) -> None:
        rollout = timed.timed_hooks.tape.rollout
        levels["game"] = self._watched(lambda: replay.play(start, rollout))
        self._same_games &= replay.arrived
        levels["victim"] = self._watched(lambda: replay.play_victim(start, rollout))
        self._same_games &= replay.arrived

    def _watched(self, work: Callable[[], float]) -> tuple[float, float]:
        """Seconds that ``work`` says it took, and the largest memory meanwhile."""
        self._memory.take()
        seconds = work()
        return seconds, self._memory.take()


def _setting(contestant: Contestant) -> Setting:
    config = contestant.attack.config
    return Setting(
        env=config.env,
        physics=str(contestant.attack.game.settings.get("physics", "")),
        victim=config.victim,
        num_envs=config.num_envs,
        threads=config.threads,
        num_steps=config.ppo.num_steps,
    )
