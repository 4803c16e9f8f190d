"""The imitator's linear programme against brute force."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from players import Scene, scenes

from apil_theory.games import ADVERSARY, VICTIM, random_game, rock_paper_scissors
from apil_theory.imitation import Imitation
from apil_theory.policies import random_policy


def problem(scene: Scene, **changes: float) -> Imitation:
    return Imitation(scene.game, scene.victim, scene.adversary, **changes)


@given(scenes())
@settings(deadline=None, max_examples=12)
def test_no_imitator_is_better_than_the_programmes(scene: Scene) -> None:
    asked = problem(scene, beta=float(scene.rng.choice([0.0, 1.0])))
    best, value = asked.solve()
    room = 1e-7 * (1 + abs(value))
    assert best.sum(1) == pytest.approx(np.ones(len(best)))
    assert asked.value(best) == pytest.approx(value, rel=1e-6, abs=1e-6)
    for spread in (0.1, 1.0):
        other = random_policy(scene.rng, *best.shape, spread)
        assert asked.value(other) <= value + room
        assert asked.value(0.99 * best + 0.01 * other) <= value + room


@given(scenes())
@settings(deadline=None, max_examples=12)
def test_no_discriminator_is_lower_than_the_least(scene: Scene) -> None:
    asked, imitator = problem(scene), scene.moved_victim
    least = asked.value_against(imitator, asked.discriminator(imitator))
    assert least == pytest.approx(asked.value(imitator))
    for _ in range(10):
        within = scene.rng.uniform(asked.low, asked.high, imitator.shape)
        assert asked.value_against(imitator, within) >= least - 1e-9 * (1 + abs(least))


def test_every_discriminator_at_the_ends_and_a_grid_of_imitators() -> None:
    rng = np.random.default_rng(0)
    game = random_game(rng, states=2, actions=(2, 2))
    asked = Imitation(game, random_policy(rng, 2, 2), random_policy(rng, 2, 2), 0.2, 0.7)
    imitator = random_policy(rng, 2, 2)
    ends = (np.reshape(d, (2, 2)) for d in itertools.product((0.2, 0.7), repeat=4))
    assert asked.value(imitator) == pytest.approx(min(asked.value_against(imitator, d) for d in ends))
    grid = np.linspace(0, 1, 41)
    rows = (np.array([[p, 1 - p], [q, 1 - q]]) for p in grid for q in grid)
    _, best = asked.solve()
    assert best - 0.05 <= max(asked.value(row) for row in rows) <= best + 1e-9


def test_value_negation_weakens_the_adversary() -> None:
    """The larger β, the lower V_α against the imitator; at a large β it plays the adversary's worst case."""
    game, rng = rock_paper_scissors(), np.random.default_rng(1)
    asked = Imitation(game, random_policy(rng, 3, 3), random_policy(rng, 3, 3))
    faced = game.alone(VICTIM, asked.adversary, game.rewards[ADVERSARY])
    values = [faced.value(replace(asked, beta=beta).solve()[0]) for beta in (0.0, 1.0, 10.0, 1000.0)]
    assert all(later <= earlier + 1e-9 for earlier, later in itertools.pairwise(values))
    worst = game.alone(VICTIM, asked.adversary, -game.rewards[ADVERSARY])
    assert values[-1] == pytest.approx(-worst.value(worst.optimal_policy()))


@given(scenes())
@settings(deadline=None, max_examples=10)
def test_a_symmetric_range_asks_for_the_victims_occupancy(scene: Scene) -> None:
    """With D^U = 1 − D^L, J is a constant − ½ log(D^U / D^L) · Σ|ρ̃ − ρ^ν|: APIL's best is the victim."""
    asked = problem(scene, low=0.1, high=0.9, beta=0.0)
    seat = scene.game.alone(VICTIM, scene.adversary, np.zeros(len(scene.victim)))
    apart = np.abs(seat.occupancy(scene.moved_victim) - seat.occupancy(scene.victim)).sum()
    most = (np.log(0.1) + np.log(0.9)) / (1 - scene.game.gamma)
    assert asked.value(scene.moved_victim) == pytest.approx(most - 0.5 * np.log(9) * apart)
    assert asked.value(scene.victim) == pytest.approx(most)
    assert asked.solve()[1] == pytest.approx(most)


def test_a_lopsided_range_does_not() -> None:
    """At [1e-6, ½] an imitator that acts correctly half of the time is as good as the victim."""
    game, rng = rock_paper_scissors(), np.random.default_rng(2)
    victim = np.eye(3)[[0, 1, 2]]
    asked = Imitation(game, victim, random_policy(rng, 3, 3), low=1e-6, high=0.5, beta=0.0)
    careless = 0.5 * victim + 0.5 * random_policy(rng, 3, 3)
    assert asked.value(careless) == pytest.approx(asked.value(victim), abs=1e-9)
    assert asked.solve()[1] == pytest.approx(asked.value(victim))
    fair = replace(asked, low=0.1, high=0.9)
    assert fair.value(careless) < fair.value(victim) - 1
