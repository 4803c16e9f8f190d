"""Small two-player games whose rewards depend on the state alone, as the theorems assume.

α is the adversary, ν the victim. S states, A and B actions. What the players did shows in the next state,
so an outcome is a state, and its reward is what the state is worth.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .mdp import MDP

ADVERSARY, VICTIM = 0, 1


@dataclass(frozen=True)
class TabularGame:
    """A finite discounted two-player Markov game.

    Attributes:
        transition: (S, A, B, S), rows sum to 1.
        rewards: (2, S), of the adversary and of the victim.
        start: (S,), distribution of the first state.
        gamma: discount per step, in [0, 1).
    """

    transition: np.ndarray
    rewards: np.ndarray
    start: np.ndarray
    gamma: float

    @property
    def difference(self) -> np.ndarray:
        """Δr = r^α − r^ν, shape (S,)."""
        difference: np.ndarray = self.rewards[ADVERSARY] - self.rewards[VICTIM]
        return difference

    def actions(self, side: int) -> int:
        """Number of that side's actions."""
        return int(self.transition.shape[1 + side])

    def alone(self, side: int, other: np.ndarray, reward: np.ndarray) -> MDP:
        """The decision problem of one side while the other is fixed.

        Args:
            side: index of the learning side.
            other: the other side's policy, (S, its actions).
            reward: of states, (S,), or of states and the learner's actions, (S, its actions).
        """
        inner = "sb,sabt->sat" if side == ADVERSARY else "sa,sabt->sbt"
        transition = np.einsum(inner, other, self.transition)
        rewards = reward[:, None] if reward.ndim == 1 else reward
        return MDP(transition, np.broadcast_to(rewards, transition.shape[:2]), self.start, self.gamma)

    def predicted(self, reader: np.ndarray, victim: np.ndarray, reward: np.ndarray) -> MDP:
        """Decision problem of an imitator that only predicts: the victim acts, and α reads the prediction ã.

        So the games of ``rollouts: shared`` (docs/methods.md §3) look to the imitator.

        Args:
            reader: the adversary's policy π^α(a | s, ã), (S, B, A).
            victim: π^ν, (S, B).
            reward: (S,) or (S, B), of states and predictions.
        """
        transition = np.einsum("sca,sb,sabt->sct", reader, victim, self.transition)
        rewards = reward[:, None] if reward.ndim == 1 else reward
        return MDP(transition, np.broadcast_to(rewards, transition.shape[:2]), self.start, self.gamma)


def rock_paper_scissors(gamma: float = 0.9, tie_cost: float = 0.25) -> TabularGame:
    """Rock, paper, scissors without end: the state is the last round's outcome (tie, α won, ν won).

    A win is worth 1, a loss −1, and a tie costs both ``tie_cost``. Starts in the tie, whose cost counts too.
    """
    transition = np.zeros((3, 3, 3, 3))
    for mine in range(3):
        for theirs in range(3):
            transition[:, mine, theirs, (mine - theirs) % 3] = 1.0
    rewards = np.array([[-tie_cost, 1.0, -1.0], [-tie_cost, -1.0, 1.0]])
    return TabularGame(transition, rewards, np.array([1.0, 0.0, 0.0]), gamma)


def tug_of_war(gamma: float = 0.9, slip: float = 0.1, idle_cost: float = 0.25) -> TabularGame:
    """A chain of five states: α pulls to the right end, ν to the left one, each or neither (2 actions).

    The state moves by the difference of the pulls, or, with probability ``slip``, not at all; from an end
    the next round begins in the middle. The right end is worth 1 to α and −1 to ν, the left one the
    reverse, and the middle costs both ``idle_cost``.
    """
    transition = np.zeros((5, 2, 2, 5))
    for state in range(5):
        for pull in range(2):
            for counter in range(2):
                moved = 2 if state in (0, 4) else state + pull - counter
                transition[state, pull, counter, moved] += 1 - slip
                transition[state, pull, counter, state] += slip
    rewards = np.array([[-1.0, 0.0, -idle_cost, 0.0, 1.0], [1.0, 0.0, -idle_cost, 0.0, -1.0]])
    return TabularGame(transition, rewards, np.eye(5)[2], gamma)


def coin(gamma: float = 0.9) -> TabularGame:
    """α alone chooses which of two states comes next; the other state is ν's. The Lemma is tight here."""
    transition = np.zeros((2, 2, 1, 2))
    transition[:, [0, 1], 0, [0, 1]] = 1.0
    return TabularGame(transition, np.array([[-1.0, 1.0], [1.0, -1.0]]), np.full(2, 0.5), gamma)


def random_game(
    rng: np.random.Generator,
    *,
    states: int = 4,
    actions: tuple[int, int] = (3, 2),
    gamma: float = 0.9,
    spread: float = 0.3,
    scale: float = 1.0,
) -> TabularGame:
    """Dirichlet transitions and normal rewards, drawn separately for each side.

    Args:
        rng: draws everything.
        states, actions: sizes.
        gamma: discount.
        spread: Dirichlet concentration; small: nearly deterministic.
        scale: standard deviation of the rewards, around means of the same scale.
    """
    transition = rng.dirichlet(np.full(states, spread), size=(states, *actions))
    rewards = scale * (rng.normal(size=(2, states)) + rng.normal(size=(2, 1)))
    return TabularGame(transition, rewards, rng.dirichlet(np.ones(states)), gamma)
