"""What a run trained, as another run's victim: pinned, resumed exactly, and its errors told as its own."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import torch
from helpers.small_runs import differences, final_state, small_config

from apil_core import (
    ConfigError,
    OpponentInsideEnv,
    PluginError,
    RunDirError,
    VictimError,
    evaluate,
    load_policy,
    resume,
    run,
)
from apil_core.training.storage import checkpoint
from apil_core.training.storage.run_dir import RunDir

BLUNDER = """
from apil_core import ApilError, Method, MethodSpec, hookimpl

patience = [10**9]


class Blunder(Method):
    @hookimpl
    def extend_observation(self, context, view):
        patience[0] -= 1
        if patience[0] < 0:
            raise ZeroDivisionError("lost")
        return {"all": view.own * 0}


@hookimpl
def register_methods():
    return [MethodSpec("blunder", f"{__name__}:Blunder")]
"""

FOG = """
from apil_core import hookimpl

@hookimpl
def filter_observation(side, obs):
    return obs * 0.9
"""


def evader_config(method: str = "apil", **changes: Any) -> Any:
    """A run that trains the evader, which is attacked by default."""
    return small_config(method, victim="baseline:random/7x2", victim_side=1, steps=1024, **changes)


@pytest.fixture(scope="module")
def evader(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run that trained an evader which draws from a generator of its own whenever it acts."""
    path = tmp_path_factory.mktemp("victim") / "evader"
    run(evader_config(options={"apil": {"prediction": "noise"}}), out=path)
    return path


@pytest.fixture
def plugin(tmp_path: Path) -> Iterator[Path]:
    yield tmp_path
    for name in ("blunder", "fog"):
        sys.modules.pop(name, None)


@pytest.mark.parametrize("form", ["{}", "run:{}"])
def test_it_is_pinned_to_its_newest_checkpoint(
    evader: Path, tmp_path: Path, form: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(evader.parent)
    result = run(
        small_config("adrl", victim=form.format(evader.name), evaluation={"episodes": 8}), out=tmp_path / "r"
    )
    stored = RunDir(tmp_path / "r").config()
    newest = RunDir(evader).newest_checkpoint()
    assert stored.victim == f"run:{newest}"
    assert result.evaluation is not None
    assert result.evaluation.victim.sha256 == stored.victim_sha256
    monkeypatch.chdir(tmp_path)
    assert evaluate("r", episodes=4).victim.name == f"run:{newest}"


@pytest.mark.parametrize("method", [pytest.param("adrl", marks=pytest.mark.slow), "e_apil"])
def test_resume_is_bit_exact_with_the_victims_own_generator(
    evader: Path, tmp_path: Path, method: str
) -> None:
    config = {"victim": f"run:{evader}", "victim_actions": "mode"}
    run(small_config(method, **config), out=tmp_path / "whole")
    run(small_config(method, steps=1024, **config), out=tmp_path / "parts")
    resume(tmp_path / "parts", steps=small_config().steps)
    whole, parts = (final_state(tmp_path / name) for name in ("whole", "parts"))
    assert differences(whole, parts) == []
    fresh = final_state(tmp_path / "whole")["env"]["victim"]["generator"]
    run(small_config(method, steps=512, **config), out=tmp_path / "short")
    assert not torch.equal(fresh, final_state(tmp_path / "short")["env"]["victim"]["generator"])


def test_the_victim_changes_nothing_in_the_adversarys_initial_weights(evader: Path, tmp_path: Path) -> None:
    for name, victim in (("a", f"run:{evader}"), ("b", "random")):
        run(
            small_config("adrl", victim=victim, steps=512, ppo={"num_steps": 16, "learning_rate": 1e-30}),
            out=tmp_path / name,
        )
    one, other = (final_state(tmp_path / name)["learner"]["ppo"]["actor_state_dict"] for name in "ab")
    assert all(torch.allclose(one[key], other[key], atol=1e-6) for key in one)


def test_a_changed_checkpoint_is_noticed(evader: Path, tmp_path: Path) -> None:
    victim = tmp_path / "victim"
    run(evader_config("adrl", checkpoint={"every_iterations": 1, "keep": 1}), out=victim)
    run(small_config("adrl", victim=str(victim)), out=tmp_path / "r")
    pinned = RunDir(victim).newest_checkpoint()
    content = pinned.read_bytes()
    pinned.write_bytes(RunDir(evader).newest_checkpoint().read_bytes())
    with pytest.raises(RunDirError, match=r"iteration-00000002\.pt is of another run or configuration"):
        resume(tmp_path / "r", steps=4096)
    pinned.write_bytes(content)
    run(evader_config("adrl", seed=5), out=tmp_path / "twin")
    pinned.write_bytes(RunDir(tmp_path / "twin").newest_checkpoint().read_bytes())
    with pytest.raises(VictimError, match="has changed since the run began: SHA-256 "):
        resume(tmp_path / "r", steps=4096)
    pinned.write_bytes(content)
    resume(victim, steps=2048)  # goes on, and drops the pinned checkpoint
    with pytest.raises(
        RunDirError, match=r"there is no checkpoint .*keep.*: apil export .* --format safetensors"
    ):
        resume(tmp_path / "r", steps=4096)


def test_it_must_fit_the_seat(evader: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="trained the evader of toy-pursuit; it cannot be the pursuer"):
        run(small_config("adrl", victim=f"run:{evader}", victim_side=1), out=tmp_path / "r")
    with pytest.raises(RunDirError, match="nowhere is no run directory"):
        run(small_config("adrl", victim="run:nowhere"), out=tmp_path / "r")
    assert not (tmp_path / "r").exists()


def test_errors_of_its_hooks_carry_its_plugins_name(plugin: Path) -> None:
    file = plugin / "blunder.py"
    file.write_text(BLUNDER)
    run(evader_config("blunder", plugins=(str(file),)), out=plugin / "evader")
    run(small_config("adrl", victim=f"run:{plugin}/evader", steps=512), out=plugin / "r")
    sys.modules["blunder"].patience[0] = 60
    with pytest.raises(
        PluginError,
        match=r"^plugin 'blunder' failed in extend_observation: ZeroDivisionError: lost \(.*\.py:[0-9]+\)$",
    ):
        resume(plugin / "r", steps=8192)
    sys.modules["blunder"].patience[0] = 60
    with pytest.raises(PluginError, match="^plugin 'blunder' failed in extend_observation"):
        evaluate(plugin / "r", episodes=50)


def test_a_run_that_filters_observations_is_refused(plugin: Path) -> None:
    file = plugin / "fog.py"
    file.write_text(FOG)
    run(evader_config("adrl", plugins=(str(file),), observers=("fog",)), out=plugin / "evader")
    with pytest.raises(ConfigError, match="filters what both sides see; it can only play as the adversary"):
        run(small_config("adrl", victim=f"run:{plugin}/evader"), out=plugin / "r")


def test_it_loads_by_name_like_any_policy(evader: Path) -> None:
    policy = load_policy(f"run:{evader}")
    assert policy.info.provenance == {"run": str(evader), "game": "toy-pursuit", "side": "evader"}
    assert policy.info.action_bounds == (-1, 1)
    older = RunDir(evader).checkpoints()[0]
    assert load_policy(f"run:{older}").info.name == f"run:{older}"


def test_settings_copied_from_a_run_pin_the_victim_anew(evader: Path, tmp_path: Path) -> None:
    run(small_config("adrl", victim=f"run:{evader}", steps=512), out=tmp_path / "r")
    copied = RunDir(tmp_path / "r").config().model_copy(update={"victim": "random"})
    assert copied.victim_sha256
    run(copied, out=tmp_path / "again")
    assert RunDir(tmp_path / "again").config().victim_sha256 != copied.victim_sha256


def test_a_run_of_before_the_hash_was_stored_is_continued(tmp_path: Path) -> None:
    run(small_config("adrl", steps=512), out=tmp_path / "r")
    file, path = RunDir(tmp_path / "r").config_path, RunDir(tmp_path / "r").newest_checkpoint()
    lines = [x for x in file.read_text().splitlines() if not x.startswith(("victim_sha256:", "trust:"))]
    file.write_text("\n".join(lines))
    state = checkpoint.read(path)
    for key in ("victim_sha256", "trust"):
        del state["config"][key]
    checkpoint.save(path, state)
    for steps in (1024, 1536):
        assert resume(tmp_path / "r", steps=steps).status == "finished"
    assert len(RunDir(tmp_path / "r").config().victim_sha256) == 64


def test_the_gymnasium_view_takes_it_as_the_opponent(evader: Path) -> None:
    env = OpponentInsideEnv("toy-pursuit", opponent=str(evader))
    rewards = []
    for _ in range(2):
        env.reset(seed=3)
        rewards.append([env.step(env.action_space.low)[1] for _ in range(5)])
    assert rewards[0] == rewards[1]
