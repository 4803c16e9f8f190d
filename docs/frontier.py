"""How far each physics setting takes a game from its faithful one, and how fast it is: data, no words."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from apil_core import ConfigError
from apil_core.common.statistics import Difference, difference
from apil_core.config.game import spelt_out
from apil_core.evaluation.fidelity.rows import FidelityRow
from apil_core.plugins.registry import default_plugins
from apil_envs.options import PhysicsProfile

LIMIT = 0.04
"""Deviation of a rate that the fast profile may have, as a fraction."""

_KEYS = tuple(each.name for each in fields(PhysicsProfile))


@dataclass(frozen=True)
class Pair:
    """Who plays whom, and how their actions are chosen."""

    env: str
    adversary: str
    victim: str
    modes: tuple[str, str]

    def __str__(self) -> str:
        versions = [name.rpartition("/")[2] for name in (self.adversary, self.victim)]
        how = [{"sample": "sampled"}.get(mode, mode) for mode in self.modes]
        return f"{' against '.join(versions)}, {'/'.join(how)}"


@dataclass(frozen=True)
class Counts:
    """The adversary's wins and ties in so many games, over all seeds there are."""

    wins: int
    ties: int
    games: int

    def minus(self, base: Counts) -> dict[str, Difference]:
        """Differences of the three rates, with Newcombe's intervals."""
        pairs = {
            "win": (self.wins, base.wins),
            "win+tie": (self.wins + self.ties, base.wins + base.ties),
            "tie": (self.ties, base.ties),
        }
        return {name: difference(a, self.games, b, base.games) for name, (a, b) in pairs.items()}


@dataclass(frozen=True)
class Speed:
    """Environment steps per second as a multiple of faithful's, measured in turns, with its spread."""

    ratio: float
    low: float
    high: float


@dataclass(frozen=True)
class Point:
    """One setting of one game in one pairing; no differences for the faithful setting itself."""

    pair: Pair
    setting: PhysicsProfile
    counts: Counts
    speed: Speed | None
    differences: dict[str, Difference]

    @property
    def verdict(self) -> str:
        """Whether all rates stay within :data:`LIMIT`: yes, no, or within noise."""
        rates = self.differences.values()
        if all(rate.low >= -LIMIT and rate.high <= LIMIT for rate in rates):
            return "yes"
        return "no" if any(rate.low > LIMIT or rate.high < -LIMIT for rate in rates) else "within noise"


def profile(env: str, name: str) -> PhysicsProfile:
    """A game's profile as the code has it."""
    return setting({**spelt_out(env, {"physics": name}, default_plugins())})


def setting(values: Mapping[str, Any]) -> PhysicsProfile:
    """From the values of all its keys."""
    return PhysicsProfile(**{key: values[key] for key in _KEYS})


def read_speeds(path: Path) -> dict[tuple[str, PhysicsProfile], Speed]:
    """Rows ``{"env", "setting": {option: value}, "ratio", "low", "high"}``; the last of a setting counts.

    Raises:
        ConfigError: it is not there, or a line is no such row.
    """
    if not path.is_file():
        raise ConfigError(f"{path}: no such file")
    speeds = {}
    for number, line in enumerate(path.read_text("utf-8").splitlines(), 1):
        try:
            row = json.loads(line)
            played = spelt_out(row["env"], row["setting"], default_plugins())
            speeds[row["env"], setting(played)] = Speed(*(float(row[k]) for k in ("ratio", "low", "high")))
        except (ValueError, KeyError, TypeError) as error:
            raise ConfigError(f"{path}:{number}: this line is no measured speed") from error
    return speeds


def points(
    rows: Iterable[FidelityRow],
    known: Iterable[FidelityRow],
    speeds: Mapping[tuple[str, PhysicsProfile], Speed],
) -> list[Point]:
    """Every setting of ``rows`` beside its faithful one, by game and pairing, the slowest first.

    Args:
        rows: of ``apil fidelity``; those with options changed besides the physics are left out.
        known: further rows, where faithful games are taken from that ``rows`` lack.
        speeds: by game and setting.

    Raises:
        ConfigError: a pairing was never played faithfully.
    """
    played, before = _counts(rows), _counts(known)
    found = []
    for pair in dict.fromkeys(pair for pair, _ in played):
        true = profile(pair.env, "faithful")
        base = played.get((pair, true)) or before.get((pair, true))
        if base is None:
            raise ConfigError(f"{pair.env}, {pair}: no faithful games to compare with")
        found.append(Point(pair, true, base, Speed(1, 1, 1), {}))
        others = {each: counts for (other, each), counts in played.items() if other == pair and each != true}
        cheap = [
            Point(pair, each, counts, speeds.get((pair.env, each)), counts.minus(base))
            for each, counts in others.items()
        ]
        found += sorted(cheap, key=lambda point: point.speed.ratio if point.speed else 0.0)
    return found


def _counts(rows: Iterable[FidelityRow]) -> dict[tuple[Pair, PhysicsProfile], Counts]:
    by_seed: dict[tuple[Pair, PhysicsProfile], dict[int, Counts]] = {}
    for row in rows:
        result = row.result
        played = _played(row)
        if played is None:
            continue
        pair = Pair(
            result.env,
            row.plan.adversary,
            row.plan.victim,
            (result.adversary_actions, result.victim_actions),
        )
        counts = Counts(result.wins, result.ties, result.episodes)
        seeds = by_seed.setdefault((pair, played), {})
        if result.seed not in seeds or seeds[result.seed].games < counts.games:
            seeds[result.seed] = counts
    return {
        key: Counts(*(sum(getattr(each, name) for each in seeds.values()) for name in Counts.__annotations__))
        for key, seeds in by_seed.items()
    }


def _played(row: FidelityRow) -> PhysicsProfile | None:
    """The physics a row was played in; ``None`` if another option was changed, too."""
    env, plugins = row.result.env, default_plugins()
    default = spelt_out(env, {}, plugins)
    then = {**default, **row.result.options_played}  # scores from before `refresh` had none, as by default
    same = all(then[key] == value for key, value in default.items() if key not in (*_KEYS, "physics"))
    return setting(then) if same else None
