"""Tightness of the bounds: gap over bound on many random perturbations."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from .comparisons import (
    Comparison,
    moved_victim,
    other_adversary,
    transferred_imitator,
)
from .games import (
    ADVERSARY,
    VICTIM,
    TabularGame,
    random_game,
    rock_paper_scissors,
    tug_of_war,
)
from .imitation import Imitation
from .policies import at_distance, random_policy


@dataclass(frozen=True)
class Looseness:
    """One bound on one kind of game.

    Attributes:
        bound, game: their names.
        draws: perturbations tried.
        violations: of them with a gap above the bound.
        median, largest: ratio of gap and bound.
    """

    bound: str
    game: str
    draws: int
    violations: int
    median: float
    largest: float


@dataclass(frozen=True)
class _Scene:
    """A game, both players, and both after their change."""

    game: TabularGame
    victim: np.ndarray
    adversary: np.ndarray
    moved_victim: np.ndarray
    moved_adversary: np.ndarray


GAMES: dict[str, Callable[[np.random.Generator], TabularGame]] = {
    "rock, paper, scissors": lambda rng: rock_paper_scissors(),
    "tug of war": lambda rng: tug_of_war(),
    "random, 4 states": random_game,
}

BOUNDS: dict[str, Callable[[_Scene], Comparison]] = {
    "Lemma, as printed": lambda s: other_adversary(s.game, s.victim, s.adversary, s.moved_adversary),
    "Lemma, mean KL": lambda s: other_adversary(s.game, s.victim, s.adversary, s.moved_adversary, "mean"),
    "Lemma, summed over visits": lambda s: other_adversary(
        s.game, s.victim, s.adversary, s.moved_adversary, "visits"
    ),
    "unfixed victim": lambda s: moved_victim(s.game, s.victim, s.moved_victim),
    "imitator, other adversary": lambda s: transferred_imitator(
        Imitation(s.game, s.victim, s.adversary), s.moved_adversary
    ),
}


def survey(draws: int = 300, seed: int = 0) -> Iterator[Looseness]:
    """Each bound on each kind of game, γ = 0.9.

    Policies are uniform on the simplex and move towards nearly deterministic ones, in each state by a KL of
    its own between 1e-4 and 1 bit.

    Args:
        draws: per bound and game.
        seed: of everything drawn.
    """
    for game, make in GAMES.items():
        for bound, compare in BOUNDS.items():
            rng = np.random.default_rng(seed)
            found = [compare(_scene(make(rng), rng)) for _ in range(draws)]
            ratios = [comparison.ratio for comparison in found]
            violations = sum(not comparison.holds for comparison in found)
            median, largest = max(float(np.median(ratios)), 0.0), float(np.max(ratios))
            yield Looseness(bound, game, draws, violations, median, largest)


def _scene(game: TabularGame, rng: np.random.Generator) -> _Scene:
    def pair(side: int) -> tuple[np.ndarray, np.ndarray]:
        size = (len(game.start), game.actions(side))
        policy = random_policy(rng, *size)
        bits = 10 ** rng.uniform(-4, 0, size[0])
        return policy, at_distance(policy, random_policy(rng, *size, spread=0.1), bits)

    (victim, other_victim), (adversary, other) = pair(VICTIM), pair(ADVERSARY)
    return _Scene(game, victim, adversary, other_victim, other)
