"""PPO for a network with memory: batches repeat what was played, and updates go the right way."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import torch
from tensordict import TensorDict
from torch import Tensor

from apil_core import load_policy
from apil_core.api.config import PPOConfig
from apil_core.policies.network import NetworkShape, PolicyNetwork
from apil_core.runs.retraining.trainable import trainable
from apil_core.training.ppo_storage import LATENT
from apil_core.training.recurrent_ppo import NetworkLearner, NetworkModel
from apil_core.training.rollout_buffer import RolloutBuffer
from retraining.victims import student

STEPS, GAMES = 12, 8
MLP = NetworkShape("mlp", 7, 1, 0, (8,), 3.0)
LSTM = NetworkShape("lstm", 7, 1, 8, (), 3.0, 6)


def learner(
    path: Path, kind: str, critic: NetworkShape = MLP, *, frozen: bool = False, **config: Any
) -> NetworkLearner:
    parts = trainable(load_policy(student(path / "s.safetensors", kind)))
    torch.manual_seed(3)
    ppo = PPOConfig(num_steps=STEPS, **{"minibatches": 2, "epochs": 2, **config})
    actor = NetworkModel(PolicyNetwork.of(parts.shape, parts.weights), parts.weights["log_std"])
    value = NetworkModel(PolicyNetwork(critic)).requires_grad_(not frozen)
    example, rollout = seen(torch.zeros(GAMES, 7)), RolloutBuffer(STEPS)
    return NetworkLearner(actor, value, example, rollout, ppo, torch.device("cpu"), 50)


def seen(observation: Tensor) -> TensorDict:
    return TensorDict({"own": observation}, batch_size=[len(observation)])


def play(victim: NetworkLearner, reward: Any, seed: int = 0) -> Tensor:
    """A rollout on random observations, collected as trainers do; its advantages.

    The reward is a function of the action (n, a).
    """
    generator = torch.Generator().manual_seed(seed)
    with torch.inference_mode():
        for t in range(STEPS):
            action = victim.act(seen(torch.randn(GAMES, 7, generator=generator)))
            victim.storage.actions[t] = action
            victim.storage.rewards[t, :, 0] = reward(action)
            victim.storage.dones[t, :, 0] = torch.rand(GAMES, generator=generator) < 0.2
            victim.ended(victim.storage.dones[t, :, 0])
    return victim.advantages(seen(torch.randn(GAMES, 7, generator=generator)), {})["reward"]


def batches(victim: NetworkLearner) -> Iterator[Any]:
    recurrent = victim.policy.is_recurrent or victim.critic.is_recurrent
    storage = victim.storage
    return (storage.recurrent_mini_batch_generator if recurrent else storage.mini_batch_generator)(2, 2)


@pytest.mark.parametrize("kind", ["mlp", "lstm"])
def test_batches_give_the_distribution_that_was_drawn_from(tmp_path: Path, kind: str) -> None:
    """In the second rollout, too, whose games began before it: the ratio of every step is 1."""
    victim = learner(tmp_path, kind)
    play(victim, lambda action: action[:, 0])
    victim.forget()
    play(victim, lambda action: action[:, 0], seed=1)
    found = list(batches(victim))
    assert sum(len(batch.actions) for batch in found) == 2 * STEPS * GAMES
    for batch in found:
        with torch.no_grad():
            victim.policy(batch.observations, batch.masks, batch.hidden_states[0], stochastic_output=True)
            log_prob = victim.policy.get_output_log_prob(batch.actions)
        assert torch.allclose(log_prob, batch.old_actions_log_prob[:, 0], atol=1e-5)
    if kind == "lstm":
        h, _ = victim.storage.states[0]
        assert float(h.abs().max()) > 0.01  # games did begin before the rollout


@pytest.mark.parametrize("kind", ["mlp", "lstm"])
def test_a_critic_with_memory_begins_each_game_without(tmp_path: Path, kind: str) -> None:
    """Before an update it says of every batch what it said of the rollout, beside any actor."""
    both = learner(tmp_path, kind, LSTM)
    play(both, lambda action: action[:, 0])
    both.forget()
    play(both, lambda action: action[:, 0], seed=1)
    for batch in batches(both):
        with torch.no_grad():
            values = both.critic(batch.observations, batch.masks, batch.hidden_states[1])
        assert torch.allclose(values, batch.values, atol=1e-5)
    # within a game the past matters, beyond its end it does not
    value, alone = both.storage.values[..., 0], values_without_memory(both)
    assert not torch.allclose(value[1:], alone[1:], atol=1e-3)
    ended = both.storage.dones[:-1, :, 0].bool()
    assert torch.allclose(value[1:][ended], alone[1:][ended], atol=1e-6)


def values_without_memory(victim: NetworkLearner) -> Tensor:
    """What its critic says of each step of a rollout as if a game began there, (T, n)."""
    z = victim.storage.observations[LATENT].flatten(0, 1).unsqueeze(0)
    network = victim.critic.network
    with torch.no_grad():
        value, _ = network(z, torch.zeros(z.shape[:2], dtype=torch.bool), network.zero_state(z.shape[1]))
    return value.view(STEPS, GAMES)


def test_memory_ends_with_the_game(tmp_path: Path) -> None:
    victim = learner(tmp_path, "lstm")
    victim.act(seen(torch.ones(GAMES, 7)))
    victim.ended(torch.arange(GAMES) < 3)
    h, c = victim._states[0]
    assert not h[:3].any()
    assert not c[:3].any()
    assert h[3:].all(1).all()


@pytest.mark.parametrize("kind", ["mlp", "lstm"])
def test_what_is_rewarded_is_done_more(tmp_path: Path, kind: str) -> None:
    victim = learner(tmp_path, kind, learning_rate=5e-3)
    before = None
    for seed in range(25):
        advantages = play(victim, lambda action: action[:, 0] - action[:, 1], seed)
        means = victim.storage.means.flatten(0, 1).mean(0)
        before = means.clone() if before is None else before
        metrics = victim.update(advantages, as_given=False, learning_rate=5e-3)
    assert before is not None
    assert metrics["ppo/kl"] > 0
    assert means[0] > before[0] + 0.3
    assert means[1] < before[1] - 0.3


@pytest.mark.parametrize(
    ("warming_up", "fixed", "moving"), [(True, "policy", "critic"), (False, "critic", "policy")]
)
def test_a_warm_up_and_a_frozen_critic_leave_what_they_should(
    tmp_path: Path, warming_up: bool, fixed: str, moving: str
) -> None:
    victim = learner(tmp_path, "lstm", frozen=not warming_up)
    advantages = play(victim, lambda action: action[:, 0])
    before = {part: [p.clone() for p in getattr(victim, part).parameters()] for part in (fixed, moving)}
    victim.update(advantages, as_given=False, learning_rate=1e-2, actor_fixed=warming_up)
    same = {
        part: all(torch.equal(a, b) for a, b in zip(old, getattr(victim, part).parameters(), strict=True))
        for part, old in before.items()
    }
    assert same == {fixed: True, moving: False}
