"""The gradient identities of docs/methods.md §1 and §2: printed formulas and derivatives of values."""

from __future__ import annotations

import numpy as np
import torch
from hypothesis import given, settings
from players import Scene, scenes

from apil_theory.games import ADVERSARY, VICTIM, TabularGame, rock_paper_scissors
from apil_theory.gradients import derivative, enumerated_gradient, finite_value, policy_gradient
from apil_theory.imitation import Imitation
from apil_theory.policies import random_policy, softmax

HORIZON = 3


def close(found: np.ndarray, expected: np.ndarray) -> None:
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-10 * (1 + np.abs(expected).max()))


def logits(scene: Scene, side: int) -> np.ndarray:
    return scene.rng.normal(size=(len(scene.game.start), scene.game.actions(side)))


@given(scenes())
@settings(deadline=None, max_examples=12)
def test_difference_of_values_is_climbed_by_the_policy_gradient_on_delta_r(scene: Scene) -> None:
    game, theta = scene.game, logits(scene, ADVERSARY)
    mine, theirs = (game.alone(ADVERSARY, scene.victim, reward) for reward in game.rewards)
    delta = game.alone(ADVERSARY, scene.victim, game.difference)
    close(policy_gradient(delta, theta), derivative(lambda p: mine.value(p) - theirs.value(p), theta))
    short = derivative(lambda p: finite_value(mine, p, HORIZON) - finite_value(theirs, p, HORIZON), theta)
    close(enumerated_gradient(delta, theta, HORIZON), short)


@given(scenes())
@settings(deadline=None, max_examples=12)
def test_e_apils_objective_is_climbed_by_the_policy_gradient_on_eta(scene: Scene) -> None:
    """The sign matters: without −r^α, or with +r^α, the direction differs."""
    game, psi = scene.game, logits(scene, VICTIM)
    log_d = np.log(scene.rng.uniform(0.1, 0.9, psi.shape))
    imitation = game.alone(VICTIM, scene.adversary, log_d)
    adversary = game.alone(VICTIM, scene.adversary, game.rewards[ADVERSARY])
    eta = log_d - game.rewards[ADVERSARY][:, None]
    shaped = game.alone(VICTIM, scene.adversary, eta)
    exact = derivative(lambda p: imitation.value(p) - adversary.value(p), psi)
    close(policy_gradient(shaped, psi), exact)
    short = derivative(
        lambda p: finite_value(imitation, p, HORIZON) - finite_value(adversary, p, HORIZON), psi
    )
    close(enumerated_gradient(shaped, psi, HORIZON), short)


def test_the_wrong_reward_is_told_apart() -> None:
    """A wrong reward gives another gradient, so the identities above can fail."""
    game, rng = rock_paper_scissors(), np.random.default_rng(0)
    victim, theta = random_policy(rng, 3, 3), rng.normal(size=(3, 3))
    mine, theirs = (game.alone(ADVERSARY, victim, reward) for reward in game.rewards)
    exact = derivative(lambda p: mine.value(p) - theirs.value(p), theta)
    assert np.abs(policy_gradient(mine, theta) - exact).max() > 0.1 * np.abs(exact).max()


def test_the_derivative_is_autograds() -> None:
    game, rng = rock_paper_scissors(), np.random.default_rng(1)
    mdp = game.alone(ADVERSARY, random_policy(rng, 3, 3), game.difference)
    theta = rng.normal(size=(3, 3))
    leaf = torch.tensor(theta, requires_grad=True)
    policy = leaf.softmax(-1)
    steps = torch.einsum("sa,sat->st", policy, torch.tensor(mdp.transition))
    system = torch.eye(3, dtype=torch.float64) - mdp.gamma * steps
    values = torch.linalg.solve(system, (policy * torch.tensor(mdp.reward.copy())).sum(1))
    (torch.tensor(mdp.start) @ values).backward()
    assert leaf.grad is not None
    close(derivative(mdp.value, theta), leaf.grad.numpy())


def test_the_whole_of_j_has_that_gradient_where_d_is_the_least() -> None:
    """Danskin: away from ties the minimum over D is differentiated with D held fixed."""
    game, rng = rock_paper_scissors(), np.random.default_rng(2)
    problem = Imitation(game, random_policy(rng, 3, 3), random_policy(rng, 3, 3))
    psi = rng.normal(size=(3, 3))
    eta = np.log(problem.discriminator(softmax(psi))) - game.rewards[ADVERSARY][:, None]
    found = policy_gradient(game.alone(VICTIM, problem.adversary, eta), psi)
    step = 1e-5
    for place in np.ndindex(psi.shape):
        ahead, behind = psi.copy(), psi.copy()
        ahead[place] += step
        behind[place] -= step
        slope = (problem.value(softmax(ahead)) - problem.value(softmax(behind))) / (2 * step)
        np.testing.assert_allclose(found[place], slope, atol=1e-7)


def shared_gradient(game: TabularGame, reader: np.ndarray, victim: np.ndarray, psi: np.ndarray) -> np.ndarray:
    """Gradient of −V_α with respect to an imitator that predicts while the victim plays."""
    return policy_gradient(game.predicted(reader, victim, -game.rewards[ADVERSARY]), psi)


def test_in_shared_rollouts_value_negation_teaches_only_through_what_the_adversary_reads() -> None:
    """The victim acts, so the prediction changes the game only through the adversary's reaction to it."""
    game, rng = rock_paper_scissors(), np.random.default_rng(3)
    victim, psi = random_policy(rng, 3, 3), rng.normal(size=(3, 3))
    deaf = np.repeat(random_policy(rng, 3, 3)[:, None], 3, axis=1)
    assert np.abs(shared_gradient(game, deaf, victim, psi)).max() < 1e-12
    heeding = rng.dirichlet(np.ones(3), size=(3, 3))
    assert np.abs(shared_gradient(game, heeding, victim, psi)).max() > 0.01
    # with the imitator acting in its own games, the gradient follows in either case
    own = game.alone(VICTIM, deaf[:, 0], -game.rewards[ADVERSARY])
    assert np.abs(policy_gradient(own, psi)).max() > 0.01
