"""PPO for a network with memory: pieces of a rollout repeat what was played, and updates go the right way."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import torch

from apil_core import load_policy
from apil_core.api.config import PPOConfig
from apil_core.api.types import DiagonalGaussian
from apil_core.policies.network import NetworkShape, PolicyNetwork
from apil_core.runs.retraining.learner import VictimLearner
from apil_core.runs.retraining.network import Critic, VictimNetwork, new_critic
from apil_core.runs.retraining.trainable import trainable
from retraining.victims import student

STEPS, GAMES = 12, 8


def learner(path: Path, kind: str, **config: Any) -> VictimLearner:
    parts = trainable(load_policy(student(path / "s.safetensors", kind)))
    torch.manual_seed(3)
    generators = {name: torch.Generator().manual_seed(i) for i, name in enumerate(("victim", "order"))}
    ppo = PPOConfig(num_steps=STEPS, **{"minibatches": 2, "epochs": 2, **config})
    network = VictimNetwork(parts.shape, parts.weights)
    critic = new_critic(parts.shape, (8,))
    return VictimLearner(network, critic, ppo, GAMES, freeze_critic=False, generators=generators)


def play(victim: VictimLearner, reward: Any, seed: int = 0) -> None:
    """A rollout on random observations; the reward is a function of the action (n, a)."""
    generator = torch.Generator().manual_seed(seed)
    for _ in range(STEPS):
        action = victim.act(torch.randn(GAMES, 7, generator=generator))
        victim.record(reward(action), torch.rand(GAMES, generator=generator) < 0.2)
    victim.estimate(torch.randn(GAMES, 7, generator=generator))


@pytest.mark.parametrize("kind", ["mlp", "lstm"])
def test_pieces_give_the_distribution_that_was_drawn_from(tmp_path: Path, kind: str) -> None:
    """In the second rollout, too, whose games began before it: the ratio of every step is 1."""
    victim = learner(tmp_path, kind)
    play(victim, lambda action: action[:, 0])
    victim.forget()
    play(victim, lambda action: action[:, 0], seed=1)
    pieces = list(victim._pieces())
    seen = sum(piece.done.numel() for piece in pieces)
    assert seen == 2 * STEPS * GAMES
    for piece in pieces:
        with torch.no_grad():
            mean, _ = victim.network(piece.z, piece.done, piece.actor_memory)
        present = DiagonalGaussian(mean, victim.network.log_std.detach().exp())
        assert torch.allclose(present.log_prob(piece.action), piece.log_prob, atol=1e-5)
    if kind == "lstm":
        h, _ = victim.rollout.actor_memory
        assert float(h.abs().max()) > 0.01  # games did begin before the rollout


def test_a_critic_with_memory_begins_each_game_without(tmp_path: Path) -> None:
    """Before an update it says of every piece what it said of the rollout; so no ratio is clipped either."""
    victim = learner(tmp_path, "lstm")
    shape = NetworkShape("lstm", 7, 1, 8, (), 3.0, 6)
    critic = Critic(shape, PolicyNetwork(shape).state_dict())
    both = VictimLearner(
        *(victim.network, critic, victim.config, GAMES),
        freeze_critic=False,
        generators=victim.generators,
    )
    play(both, lambda action: action[:, 0])
    both.forget()
    play(both, lambda action: action[:, 0], seed=1)
    for piece in both._pieces():
        expected = piece.advantage.square().mean()
        assert torch.allclose(both._value_loss(piece), expected, rtol=1e-4)
        assert float(both._surrogate(piece)[1]) == 0
    # within a game the past matters, beyond its end it does not
    assert not torch.allclose(both.rollout.value[1:], values_without_memory(both)[1:], atol=1e-3)
    alone = both.rollout.done[:-1]
    after_an_end = both.rollout.value[1:][alone], values_without_memory(both)[1:][alone]
    assert torch.allclose(*after_an_end, atol=1e-6)


def values_without_memory(victim: VictimLearner) -> torch.Tensor:
    """What its critic says of each step of a rollout as if a game began there, (T, n)."""
    z = victim.rollout.z.flatten(0, 1).unsqueeze(0)
    with torch.no_grad():
        nothing = victim.critic.body.zero_state(z.shape[1])
        value, _ = victim.critic(z, torch.zeros(z.shape[:2], dtype=torch.bool), nothing)
    return value.view(victim.rollout.done.shape)


def test_memory_ends_with_the_game(tmp_path: Path) -> None:
    victim = learner(tmp_path, "lstm")
    victim.act(torch.ones(GAMES, 7))
    done = torch.arange(GAMES) < 3
    victim.record(torch.zeros(GAMES), done)
    h, c = victim._memory
    assert not h[:3].any()
    assert not c[:3].any()
    assert h[3:].all(1).all()


@pytest.mark.parametrize("kind", ["mlp", "lstm"])
def test_what_is_rewarded_is_done_more(tmp_path: Path, kind: str) -> None:
    victim = learner(tmp_path, kind, learning_rate=5e-3)
    before = None
    for seed in range(25):
        play(victim, lambda action: action[:, 0] - action[:, 1], seed)
        means = victim.rollout.mean.flatten(0, 1).mean(0)
        before = means.clone() if before is None else before
        metrics = victim.update(5e-3)
    assert metrics["ppo/kl"] > 0
    assert means[0] > before[0] + 0.3
    assert means[1] < before[1] - 0.3


def test_a_warm_up_and_a_frozen_critic_leave_what_they_should(tmp_path: Path) -> None:
    victim = learner(tmp_path, "lstm", learning_rate=1e-2)
    for critic_only, frozen, moving in ((True, "network", "critic"), (False, "critic", "network")):
        victim.freeze_critic = not critic_only
        play(victim, lambda action: action[:, 0])
        before = {
            part: [p.clone() for p in getattr(victim, part).parameters()] for part in ("network", "critic")
        }
        victim.update(1e-2, critic_only=critic_only)
        same = {
            part: all(torch.equal(a, b) for a, b in zip(old, getattr(victim, part).parameters(), strict=True))
            for part, old in before.items()
        }
        assert same == {frozen: True, moving: False}
