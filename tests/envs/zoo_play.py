"""Zoo kicker against zoo keeper, played with the numpy reference nets."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from apil_envs.kick_and_defend import KEEPER, KickAndDefend

from .zoo_reference import ReferenceLSTM, load_flat

FILES = ("kicker/agent1_parameters-v1.pkl", "defender/agent2_parameters-v1.pkl")


def agents(zoo: Path) -> tuple[ReferenceLSTM, ReferenceLSTM]:
    kicker, keeper = (ReferenceLSTM(load_flat(zoo / "kick-and-defend" / name), 384, 17) for name in FILES)
    return kicker, keeper


@dataclass
class Score:
    """Endings of complete games."""

    wins: list[int] = field(default_factory=list)
    causes: list[int] = field(default_factory=list)
    lengths: list[int] = field(default_factory=list)

    @property
    def games(self) -> int:
        return len(self.wins)

    def rate(self, *winners: int) -> float:
        return float(np.isin(self.wins, winners).mean())

    @property
    def keeper_wins(self) -> int:
        return self.wins.count(KEEPER)


def play(
    zoo: Path, games: int, num_envs: int, seed: int, sample: bool = True, threads: int = 2
) -> tuple[Score, tuple[np.ndarray, np.ndarray]]:
    """Play ``games`` complete games; every game that starts is counted, so short ones are not favoured.

    Returns:
        the score, and some of both sides' observations, each (rows, 384).
    """
    players = agents(zoo)
    game = KickAndDefend(num_envs, threads)
    game.seed(seed)
    game.reset()
    rng = np.random.default_rng(seed) if sample else None
    score, seen = Score(), ([], [])
    active, started = np.ones(num_envs, bool), num_envs
    step_count = 0
    while active.any():
        observations = game.observations
        if step_count % 10 == 0:
            for kept, now in zip(seen, observations, strict=True):
                kept.append(now[active].copy())
        first, second = (p.act(o, rng) for p, o in zip(players, observations, strict=True))
        step = game.step((first, second), active)
        step_count += 1
        ended = np.flatnonzero(step.done)
        score.wins += step.winner[ended].tolist()
        score.causes += step.cause[ended].tolist()
        score.lengths += step.lengths[ended].tolist()
        again = np.zeros(num_envs, bool)
        again[ended[: games - started]] = True
        active &= ~step.done | again
        started += int(again.sum())
        game.reset(again)
        for player in players:
            player.reset(again)
    return score, (np.concatenate(seen[0]), np.concatenate(seen[1]))
