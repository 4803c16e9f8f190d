"""Alternating measured blocks, and their summary."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import torch
from pure_physics import PurePhysics
from task import Contestant


@dataclass(frozen=True)
class Block:
    """One measurement of one framework.

    Attributes:
        contestant: its name.
        turn: number of the round, from 0.
        rate: environment steps per second.
        physics: the same of pure physics, the mean of right before and right after; ``None`` where a game
            has no physics of its own.
    """

    contestant: str
    turn: int
    rate: float
    physics: float | None


def measure(
    contestants: Sequence[Contestant],
    physics: PurePhysics | None,
    *,
    seconds: float,
    least: float,
    tell: Callable[[Block], None],
) -> list[Block]:
    """Measure rounds of blocks until the time is up, two at least.

    Args:
        contestants: warmed up.
        physics: timed before and after each block.
        seconds: for all of it; the round that is under way then is finished.
        least: seconds of a block; whole iterations are counted.
        tell: called with a line for each block.
    """
    blocks: list[Block] = []
    begin, turn = time.perf_counter(), 0
    before = _physics_rate(physics, least)
    while turn < 2 or time.perf_counter() - begin < seconds:
        for contestant in contestants:
            rate = _rate(contestant, least)
            after = _physics_rate(physics, least)
            mean = None if before is None or after is None else (before + after) / 2
            blocks.append(Block(contestant.name, turn, rate, mean))
            before = after
            tell(blocks[-1])
        turn += 1
    return blocks


def _rate(contestant: Contestant, least: float) -> float:
    torch.set_num_threads(contestant.torch_threads)
    steps, begin = 0, time.perf_counter()
    while (spent := time.perf_counter() - begin) < least or not steps:
        steps += contestant.iterate()
    return steps / spent


def _physics_rate(physics: PurePhysics | None, least: float) -> float | None:
    if physics is None:
        return None
    steps, seconds = 0, 0.0
    while seconds < least:
        more, spent = physics.timed()
        steps, seconds = steps + more, seconds + spent
    return steps / seconds


@dataclass(frozen=True)
class Spread:
    """Median and range of the values of all rounds."""

    median: float
    low: float
    high: float

    @classmethod
    def of(cls, values: Sequence[float]) -> Spread:
        """Median and range."""
        return cls(statistics.median(values), min(values), max(values))


@dataclass(frozen=True)
class Standing:
    """The result of one framework.

    Attributes:
        rate: environment steps per second.
        of_physics: its rate over that of the physics beside it, or ``None``.
        over_sb3: its rate over that of Stable-Baselines3 in the same round, or ``None`` without it.
        over_sb3_beside_physics: the same ratio of both shares of the physics measured beside them, which
            cancels changes of the machine's load; ``None`` without either.
    """

    contestant: str
    rate: Spread
    of_physics: Spread | None
    over_sb3: Spread | None
    over_sb3_beside_physics: Spread | None


def standings(blocks: Sequence[Block]) -> list[Standing]:
    """Results in order; ratios refer to the fastest of Stable-Baselines3's vectorisations."""
    reference = sb3_reference(blocks)
    return [_standing(name, blocks, reference) for name in dict.fromkeys(b.contestant for b in blocks)]


def sb3_reference(blocks: Sequence[Block]) -> str | None:
    """Name of the Stable-Baselines3 variant with the highest median."""
    names = {block.contestant for block in blocks if block.contestant.startswith("sb3 ")}
    return max(sorted(names), key=lambda name: statistics.median(_rates(blocks, name).values()), default=None)


def _standing(name: str, blocks: Sequence[Block], reference: str | None) -> Standing:
    rates, shares = _rates(blocks, name), _shares(blocks, name)
    their_rates = _rates(blocks, reference) if reference else {}
    their_shares = _shares(blocks, reference) if reference else {}
    return Standing(
        name,
        Spread.of(list(rates.values())),
        Spread.of(list(shares.values())) if shares else None,
        _quotient(rates, their_rates),
        _quotient(shares, their_shares),
    )


def _rates(blocks: Sequence[Block], name: str) -> dict[int, float]:
    return {block.turn: block.rate for block in blocks if block.contestant == name}


def _shares(blocks: Sequence[Block], name: str) -> dict[int, float]:
    """Fraction of the physics' rate measured beside it, by round."""
    own = [block for block in blocks if block.contestant == name]
    return {block.turn: block.rate / block.physics for block in own if block.physics is not None}


def _quotient(ours: Mapping[int, float], theirs: Mapping[int, float]) -> Spread | None:
    """Divide round by round."""
    values = [value / theirs[turn] for turn, value in ours.items() if turn in theirs]
    return Spread.of(values) if values else None


def physics_rate(blocks: Sequence[Block]) -> Spread | None:
    """Steps per second of the physics measured beside the blocks."""
    rates = [block.physics for block in blocks if block.physics is not None]
    return Spread.of(rates) if rates else None


def table(blocks: Sequence[Block]) -> str:
    """Format a table for the terminal."""
    return "\n".join(_lines(blocks))


def _lines(blocks: Sequence[Block]) -> Iterator[str]:
    heads = ("steps/s", "of pure physics", "over SB3", "over SB3, by physics")
    yield f"{'median [range]':18}" + "".join(f"{head:>26}" for head in heads)
    physics = physics_rate(blocks)
    if physics is not None:
        yield f"{PurePhysics.name:18}{_shown(physics, '.0f'):>26}"
    for one in standings(blocks):
        cells = (_shown(one.rate, ".0f"), _shown(one.of_physics, ".3f"), _shown(one.over_sb3, ".2f"))
        yield f"{one.contestant:18}" + "".join(
            f"{cell:>26}" for cell in (*cells, _shown(one.over_sb3_beside_physics, ".2f"))
        )
    yield f"SB3 is {sb3_reference(blocks) or 'absent'}; ranges are over {blocks[-1].turn + 1} rounds"


def _shown(spread: Spread | None, form: str) -> str:
    if spread is None:
        return "-"
    return f"{spread.median:{form}} [{spread.low:{form}}, {spread.high:{form}}]"


def as_json(blocks: Sequence[Block]) -> dict[str, Any]:
    """Convert to JSON data."""
    physics = physics_rate(blocks)
    return {
        "physics": physics and asdict(physics),
        "sb3_reference": sb3_reference(blocks),
        "standings": [asdict(one) for one in standings(blocks)],
        "blocks": [asdict(block) for block in blocks],
    }
