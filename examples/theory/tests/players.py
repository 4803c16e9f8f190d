"""Random games with players, for property tests."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from hypothesis import strategies as st

from apil_theory.games import (
    ADVERSARY,
    VICTIM,
    TabularGame,
    random_game,
    rock_paper_scissors,
    tug_of_war,
)
from apil_theory.policies import at_distance, random_policy


@dataclass(frozen=True)
class Scene:
    """A game, both players, and both after a change (each state by a KL of its own)."""

    game: TabularGame
    adversary: np.ndarray
    victim: np.ndarray
    moved_adversary: np.ndarray
    moved_victim: np.ndarray
    rng: np.random.Generator


@st.composite
def scenes(draw: st.DrawFn, most_bits: float = 3.0) -> Scene:
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    gamma = draw(st.sampled_from([0.0, 0.3, 0.9, 0.98]))
    kind = draw(st.sampled_from(["rps", "tug", "random", "random"]))
    if kind == "random":
        states, mine, theirs = (draw(st.integers(2, 4)) for _ in range(3))
        scale = draw(st.sampled_from([0.1, 1.0, 100.0]))
        game = random_game(rng, states=states, actions=(mine, theirs), gamma=gamma, scale=scale)
    else:
        game = (rock_paper_scissors if kind == "rps" else tug_of_war)(gamma)
        game = replace(game, start=rng.dirichlet(np.ones(len(game.start))))
    spread = draw(st.sampled_from([0.1, 1.0]))
    bits = most_bits * 10 ** rng.uniform(-5, 0, len(game.start))

    def pair(side: int) -> tuple[np.ndarray, np.ndarray]:
        size = (len(game.start), game.actions(side))
        policy = random_policy(rng, *size)
        return policy, at_distance(policy, random_policy(rng, *size, spread=spread), bits)

    (adversary, moved), (victim, moved_victim) = pair(ADVERSARY), pair(VICTIM)
    return Scene(game, adversary, victim, moved, moved_victim, rng)
