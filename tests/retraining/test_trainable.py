"""The trainable copy does what the victim does, before anything is learnt."""

from __future__ import annotations

import copy
from pathlib import Path

import pytest
import torch
from helpers.small_runs import small_config

from apil_core import Policy, VictimError, load_policy, run
from apil_core.policies.frozen_policy import FrozenPolicy
from apil_core.policies.network import PolicyNetwork, Standardizer
from apil_core.policies.zoo_import import import_zoo
from apil_core.runs.retraining.trainable import trainable
from apil_core.training.recurrent_ppo import NetworkModel
from retraining.victims import student, views, zoo_agent


def played(policy: Policy, steps: list) -> tuple[torch.Tensor, torch.Tensor]:
    """Means and standard deviations, (T, n, a)."""
    found = [policy.act(view, sample=False).distribution for view in steps]
    return tuple(torch.stack([getattr(d, k).expand_as(d.mean) for d in found]) for k in ("mean", "std"))


def check(policy: Policy) -> None:
    steps = views(12, 5, policy.info.observation_size)
    mean, std = played(policy, steps)
    parts = trainable(policy)
    network = PolicyNetwork.of(parts.shape, parts.weights)
    mean_seen, std_seen = (parts.weights[f"observation.{name}"] for name in ("mean", "std"))
    z = Standardizer(mean_seen, std_seen, parts.shape.clip)(torch.stack([view.own for view in steps]))
    done = torch.stack([view.first for view in [*steps[1:], steps[0]]])
    with torch.no_grad():
        together, _ = network(z, done, network.zero_state(5))
    assert torch.allclose(together, mean, atol=2e-5)
    assert torch.allclose(parts.weights["log_std"].exp().expand_as(std), std, rtol=1e-6)
    assert float(mean.std()) > 0.01
    again = FrozenPolicy(policy.info, parts.shape, parts.weights)
    assert torch.allclose(played(again, steps)[0], mean, atol=2e-5)
    assert all(parameter.requires_grad for parameter in network.parameters())


@pytest.mark.parametrize("recurrent", [False, True])
def test_a_zoo_agent_and_its_critic(recurrent: bool) -> None:
    agent = zoo_agent(recurrent=recurrent)
    check(agent)
    steps = views(8, 4, 9, seed=2)
    stored = trainable(agent).critic
    assert stored is not None
    before = PolicyNetwork.of(stored.shape, stored.weights)
    critic = NetworkModel(copy.deepcopy(before))
    critic.rescale(0.5 * stored.deviation, 0.5 * stored.mean)
    z = torch.stack([agent.standardize(view.own) for view in steps])
    done = torch.stack([view.first for view in [*steps[1:], steps[0]]])
    with torch.no_grad():
        values, found = (net(z, done, net.zero_state(4))[0] for net in (before, critic.network))
    assert torch.allclose(found, 0.5 * (stored.deviation * values + stored.mean), atol=1e-4)


@pytest.mark.parametrize("kind", ["mlp", "lstm"])
def test_a_student(kind: str, tmp_path: Path) -> None:
    policy = load_policy(student(tmp_path / "s.safetensors", kind))
    check(policy)
    parts = trainable(policy)
    assert all(torch.equal(parts.weights[name], tensor) for name, tensor in policy.weights.items())


def test_what_a_run_trained(tmp_path: Path) -> None:
    run(small_config("adrl", steps=1024, ppo={"action_unit": "limit"}), out=tmp_path / "r")
    policy = load_policy(f"run:{tmp_path / 'r'}")
    check(policy)
    policy.actor.unit = policy.actor.model.mlp[-1].factor = 0.4  # toy-pursuit's own limit is 1
    check(policy)


def test_the_real_zoo(zoo_dir: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("APIL_CACHE", str(tmp_path))
    import_zoo(zoo_dir)
    for name in ("kick-and-defend/kicker/v1", "you-shall-not-pass/runner/v1"):
        check(load_policy(f"zoo:{name}"))


def test_others_are_refused(tmp_path: Path) -> None:
    run(small_config("apil", steps=512), out=tmp_path / "r")
    for name in ("baseline:random/7x2", f"run:{tmp_path / 'r'}", "scripted:toy-pursuit/evader/v1"):
        with pytest.raises(VictimError, match="cannot be retrained; what can: zoo:…, embedded:"):
            trainable(load_policy(name))


def test_the_network_is_given_no_random_numbers(tmp_path: Path) -> None:
    parts = trainable(load_policy(student(tmp_path / "s.safetensors")))
    before = torch.get_rng_state()
    PolicyNetwork.of(parts.shape, parts.weights)
    assert torch.equal(before, torch.get_rng_state())
