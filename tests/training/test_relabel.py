"""The hook that relabels the main reward, and the observations after each step, ends of games included."""

from __future__ import annotations

import sys
import types
from pathlib import Path
from typing import Any

import pytest
import torch
from helpers.small_runs import differences, final_state, small_config

from apil_core import Method, MethodSpec, ReturnNormalizer, hookimpl, run
from apil_core.plugins.discovery import PluginRecord, PluginRegistry, discover


def registry_with(*chain: type[Method]) -> PluginRegistry:
    """The installed plugins and methods made here, each named as its class and requiring the one before."""
    module = types.ModuleType("plugin_relabelling")
    sys.modules[module.__name__] = module
    specs, before = [], ("adrl",)
    for made in chain:
        setattr(module, made.__name__, made)
        specs.append(MethodSpec(made.__name__, f"{module.__name__}:{made.__name__}", requires=before))
        before = (made.__name__,)
    module.register_methods = hookimpl(lambda: specs)  # type: ignore[attr-defined]
    registry = discover()
    registry.add(PluginRecord("relabelling", "", "test"), module)
    return registry


def test_a_reward_relabelled_to_itself_changes_no_bit(tmp_path: Path) -> None:
    class Same(Method):
        @hookimpl
        def relabel_reward(self, rollout, reward, successors, victim_successors):
            assert torch.equal(reward, rollout.reward)  # ADRL has no terms
            assert torch.equal(rollout.shaped_reward, reward)
            return reward.clone()

    run(small_config("adrl", steps=3 * 512), out=tmp_path / "plain")
    run(small_config("Same", steps=3 * 512), out=tmp_path / "same", plugins=registry_with(Same))
    for part in ("learner", "env", "builder", "torch_rng"):
        assert not differences(final_state(tmp_path / "plain")[part], final_state(tmp_path / "same")[part])


@pytest.mark.parametrize("normalize", [True, False])
def test_plugins_follow_one_another_and_the_last_one_is_normalised(tmp_path: Path, normalize: bool) -> None:
    rollouts: list[Any] = []

    class Doubles(Method):
        @hookimpl
        def shape_reward(self, step):
            return {"term": torch.ones_like(step.reward)}

        @hookimpl
        def relabel_reward(self, rollout, reward):
            torch.testing.assert_close(reward, rollout.reward + 1)
            self.got = reward.clone()
            return 2 * reward

    class AddsThree(Method):
        @hookimpl
        def relabel_reward(self, reward):
            required = self.setup.methods["Doubles"]
            torch.testing.assert_close(reward, 2 * required.got)
            self.made = reward + 3
            return self.made

        @hookimpl
        def update_auxiliary(self, rollout):
            assert rollout.successors is None
            assert rollout.victim_successors is None
            rollouts.append((self.made, rollout.done.clone(), rollout.shaped_reward.clone()))

    config = small_config("AddsThree", steps=2 * 512, reward={"normalize": normalize})
    run(config, out=tmp_path / "r", plugins=registry_with(Doubles, AddsThree))
    normalizer = ReturnNormalizer(32, config.ppo.gamma)
    for made, done, shaped in rollouts:
        steps = [normalizer.update(made[t], done[t]) for t in range(len(made))]
        assert torch.equal(shaped, torch.stack(steps) if normalize else made)
    assert sum(int(done.sum()) for _, done, _ in rollouts) > 0
    rows = (tmp_path / "r" / "metrics.jsonl").read_text("utf-8").splitlines()
    made = rollouts[-1][0]
    assert f'"reward/relabelled": {float(made.mean())}' in rows[-1]


def test_successors_are_the_next_observations_and_the_last_ones_of_ended_games(tmp_path: Path) -> None:
    ends = 0

    class Follows(Method):
        @hookimpl
        def finish_rollout(self, rollout, successors, victim_successors):
            nonlocal ends
            seen = (rollout.observation, successors), (rollout.victim_observation, victim_successors)
            moves = (0.042, rollout.action), (0.045, rollout.victim_action)
            for (before, after), (speed, action) in zip(seen, moves, strict=True):
                # the toy game, replayed: share of time left, and own position inside the wall
                torch.testing.assert_close(after[..., 6], before[..., 6] - 1 / 10, rtol=0, atol=1e-6)
                moved = before[..., :2] + speed * action.clamp(-1, 1)
                moved = moved / moved.norm(dim=-1, keepdim=True).clamp(min=1)
                torch.testing.assert_close(after[..., :2], moved, rtol=0, atol=1e-5)
            going_on = ~rollout.done
            follow = torch.cat([rollout.observation[1:], rollout.next_observation.unsqueeze(0)])
            assert torch.equal(successors[going_on], follow[going_on])
            assert (follow[rollout.done][:, 6] == 1).all()  # a new game's first
            assert (successors[rollout.done][:, 6] < 1).all()
            assert rollout.successors is successors
            ends += int(rollout.done.sum())

    config = small_config("Follows", steps=2 * 512, game={"max_steps": 10})
    run(config, out=tmp_path / "r", plugins=registry_with(Follows))
    assert ends > 64


def test_only_what_is_asked_for_is_kept(tmp_path: Path) -> None:
    class AsksForOne(Method):
        @hookimpl
        def update_auxiliary(self, rollout, victim_successors):
            assert victim_successors.shape == rollout.victim_observation.shape
            assert rollout.successors is None

    run(small_config("AsksForOne", steps=512), out=tmp_path / "r", plugins=registry_with(AsksForOne))
    assert "reward/relabelled" not in (tmp_path / "r" / "metrics.jsonl").read_text("utf-8")
