"""Plugins defined here meet a real run: reward terms, observation groups, filters, observers; no mistakes."""

from __future__ import annotations

import pytest
import torch
from helpers.made_plugins import registry_with
from helpers.small_runs import metrics_of, small_config

from apil_core import Method, PluginError, evaluate, hookimpl, run


class Curious(Method):
    """Pays for large victim actions and shows the adversary the time since the game began."""

    seen: list = []

    def __init__(self, options, setup):
        super().__init__(options, setup)
        self.offset = torch.zeros(1)

    @hookimpl
    def shape_reward(self, run, step):
        return {"restless_victim": 0.1 * step.victim_action.abs().sum(-1)}

    @hookimpl
    def extend_observation(self, context, view):
        return {"opened": view.first.float().unsqueeze(-1) + self.offset}

    @hookimpl
    def update_auxiliary(self, run, rollout):
        assert rollout.groups["opened"].shape == (*rollout.done.shape, 1)
        assert torch.equal(rollout.groups["opened"][..., 0].bool(), rollout.first)
        weight = torch.ones((), requires_grad=True)  # plugins may train on whatever they are handed
        parts = [
            rollout.advantages,
            rollout.next_observation,
            rollout.next_groups["opened"],
            rollout.observation,
        ]
        sum((weight * part).sum() for part in parts).backward()
        assert "own" not in rollout.groups
        Curious.seen.append((run.iteration, run.steps))
        return {"share": float(rollout.first.float().mean())}

    def state_dict(self):
        return {"offset": self.offset}

    def load_state_dict(self, state):
        self.offset = state["offset"]


def test_a_plugin_changes_the_reward_and_adds_an_observation_group(tmp_path):
    Curious.seen = []
    registry = registry_with(Curious)
    run(small_config("curious"), out=tmp_path / "r", plugins=registry)
    last = metrics_of(tmp_path / "r")[-1]
    assert last["reward/restless_victim"] > 0
    assert last["reward/minus_victim"] == pytest.approx(-last["reward/victim"], abs=1e-6)
    assert 0 < last["curious/share"] < 1
    assert Curious.seen == [(i, 512 * (i + 1)) for i in range(6)]
    result = evaluate(tmp_path / "r", episodes=20, plugins=registry)
    assert result.episodes == 20


def test_observers_filter_what_a_side_sees(tmp_path):
    seen = []

    def filter_observation(context, side, obs):
        seen.append((context.mode, context.role, side))
        return torch.zeros_like(obs) if side == 1 else None

    registry = registry_with(Method, name="blind", requires=(), filter_observation=filter_observation)
    config = small_config("adrl", observers=("blind",), steps=512)
    run(config, out=tmp_path / "r", plugins=registry)
    state = torch.load(next((tmp_path / "r" / "checkpoints").iterdir()), weights_only=True)
    assert float(state["env"]["pending"]["own"].abs().sum()) == 0.0
    assert float(state["env"]["pending"]["opponent"].abs().sum()) > 0.0
    evaluate(tmp_path / "r", episodes=5, plugins=registry)
    assert {s for s in seen if s[2] == 1} == {("train", "adversary", 1), ("eval", "adversary", 1)}


def broken(hook, answer):
    return type("Broken", (Method,), {hook: hookimpl(answer)})


def crash_later(self, run, step):
    if run.steps >= 1000:
        raise RuntimeError("step 1000")


def test_a_crash_in_a_hook_keeps_the_last_checkpoint(tmp_path):
    registry = registry_with(broken("shape_reward", crash_later), name="bad", requires=())
    with pytest.raises(PluginError):
        run(small_config("bad", checkpoint={"every_iterations": 1}), out=tmp_path / "r", plugins=registry)
    assert len(list((tmp_path / "r" / "checkpoints").glob("*.pt"))) == 2
    import json

    assert json.loads((tmp_path / "r" / "result.json").read_text())["status"] == "failed"


class Odd(BaseException):
    """No Exception, as some libraries' own."""


@pytest.mark.parametrize("error", [SystemExit(0), Odd(0)])
def test_an_exit_in_a_hook_is_that_plugins_failure(tmp_path, error):
    def leave(self, run, step):
        raise error

    registry = registry_with(broken("shape_reward", leave), name="bad", requires=())
    with pytest.raises(PluginError, match=f"plugin 'bad' failed in shape_reward: {type(error).__name__}: 0"):
        run(small_config("bad"), out=tmp_path / "r", plugins=registry)
    assert '"status": "failed"' in (tmp_path / "r" / "result.json").read_text()
