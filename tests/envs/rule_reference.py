"""How five games end, one at a time, in plain Python, from the description of the originals alone."""

from __future__ import annotations

from dataclasses import dataclass

TIE = -1


@dataclass(frozen=True)
class Outcome:
    """``cause`` is ``None`` while the game goes on; ``sparse`` are the rewards of side 0 and 1."""

    cause: str | None = None
    winner: int = TIE
    sparse: tuple[float, float] = (0, 0)


def you_shall_not_pass(centre_x: float, heights: tuple[float, float], time_up: bool) -> Outcome:
    """``centre_x``: of the runner's mass, m; ``heights``: of the roots of blocker and runner, m."""
    blocker, runner = heights
    if centre_x < -4:
        return Outcome("passed", 1, (-1000, 1000))
    if runner <= 0.3:
        return Outcome("runner-down", 0, (1000 if blocker > 0.3 else 0, -1000))
    if time_up:
        return Outcome("time-up", 0, (0, -1000))
    return Outcome()


def sumo(
    heights: tuple[float, float],
    distances: tuple[float, float],
    radius: float,
    floor: float,
    touched: bool,
    time_up: bool,
) -> Outcome:
    """``distances`` from the centre; ``floor``: height (m) at which a root counts as fallen."""
    fell = [height <= floor for height in heights]
    left = [distance > radius for distance in distances]
    for lost, how in ((fell, "fell"), (left, "left-ring")):
        if all(lost):
            return Outcome(f"both-{how}", TIE, (-1000, -1000))
        if any(lost):
            return _one_lost(lost.index(True), how, touched)
    return Outcome("time-up", TIE, (-1000, -1000)) if time_up else Outcome()


def _one_lost(loser: int, how: str, touched: bool) -> Outcome:
    prize = 1000 if touched else 0
    sparse = (-1000, prize) if loser == 0 else (prize, -1000)
    if touched:
        return Outcome(f"fighter_{loser}-{how}", 1 - loser, sparse)
    return Outcome(f"fighter_{loser}-{how}-untouched", TIE, sparse)


def run_to_goal(
    positions: tuple[float, float], heights: tuple[float, float], low: float, time_up: bool
) -> Outcome:
    """``positions`` of mass centres along x; the lines: +4 for 0, -4 for 1; below ``low`` (m) one is down."""
    arrived = (positions[0] > 4, positions[1] < -4)
    if all(arrived):
        return Outcome("both-arrived")
    if arrived[0]:
        return Outcome("runner_0-arrived", 0, (1000, -1000))
    if arrived[1]:
        return Outcome("runner_1-arrived", 1, (-1000, 1000))
    if heights[0] < low and heights[1] < low:
        return Outcome("both-down")
    return Outcome("time-up") if time_up else Outcome()
