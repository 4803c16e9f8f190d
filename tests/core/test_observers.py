"""Registered observers in real runs: options, state, exact resume; and switched on for a score."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pytest
import torch

from apil_core import ApilError, evaluate, resume, run
from apil_core.config_io import complete, load_resolved
from apil_core.plugin_state import stored_and_read
from apil_core.plugins import PluginRecord, PluginRegistry, discover
from apil_core.rundir import RunDir
from core.small_runs import differences, small_config

SOURCE = '''
import torch
from apil_core import Observer, ObserverSpec, Section, hookimpl

APIL_HOOK_API = 1


class DriftOptions(Section):
    rate: float = 0.001
    """By how much the victim's view drifts with each training step."""


class Drift(Observer):
    """The victim's view is off by more and more, so that a lost count would show."""

    def __init__(self, options, setup):
        super().__init__(options, setup)
        self.steps = 0
        self.knows = sorted(setup.methods)

    @hookimpl
    def filter_observation(self, context, obs):
        if context.role != "victim":
            return None
        if context.mode == "train":
            self.steps += 1
        return obs + self.options.rate * (self.steps if context.mode == "train" else 1000)

    def state_dict(self):
        return {"steps": self.steps}

    def load_state_dict(self, state):
        self.steps = state["steps"]


@hookimpl
def register_observers():
    return [ObserverSpec("drift", f"{__name__}:Drift", config=f"{__name__}:DriftOptions")]
'''

ADVERSARY = {"env": "toy-pursuit", "victim": "scripted:toy-pursuit/evader/v1"}


@pytest.fixture
def drifting(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> PluginRegistry:
    file = tmp_path / "drifting.py"
    file.write_text(SOURCE)
    monkeypatch.delitem(sys.modules, "drifting", raising=False)
    return discover([file])


def config(**changes: Any) -> Any:
    return small_config("apl", observers=("drift",), steps=1024, **changes)


def newest(out: Path) -> dict[str, Any]:
    state: dict[str, Any] = torch.load(RunDir(out).newest_checkpoint(), weights_only=True)
    return state


def test_options_reach_it_and_are_stored(tmp_path: Path, drifting: PluginRegistry) -> None:
    run(config(options={"drift": {"rate": 0.5}}), out=tmp_path / "a", plugins=drifting)
    run(config(), out=tmp_path / "b", plugins=drifting)
    stored = load_resolved(tmp_path / "a" / "config.yaml")
    assert stored.observers == ("drift",)
    assert stored.options["drift"] == {"rate": 0.5}
    assert load_resolved(tmp_path / "b" / "config.yaml").options["drift"] == {"rate": 0.001}
    assert "# By how much the victim's view drifts" in (tmp_path / "a" / "config.yaml").read_text()
    assert differences(newest(tmp_path / "a")["learner"], newest(tmp_path / "b")["learner"])


def test_its_state_goes_on_exactly_after_a_stop(tmp_path: Path, drifting: PluginRegistry) -> None:
    keeping = {"checkpoint": {"every_iterations": 1, "keep": 9}, "plugins": (str(tmp_path / "drifting.py"),)}
    run(config(**keeping), out=tmp_path / "whole")
    run(config(**keeping), out=tmp_path / "part")
    whole, part = RunDir(tmp_path / "whole"), RunDir(tmp_path / "part")
    assert newest(whole.path)["observers"]["drift"]["steps"] > 0
    for path in part.checkpoints()[1:]:
        path.unlink()
    resume(part.path)
    assert differences(newest(whole.path), newest(part.path)) == []


def test_a_checkpoint_from_before_observers_kept_anything_still_loads(tmp_path: Path) -> None:
    out = tmp_path / "old"
    run(small_config("adrl", steps=512), out=out)
    path = RunDir(out).newest_checkpoint()
    state = torch.load(path, weights_only=True)
    del state["observers"]
    torch.save(state, path)
    assert evaluate(out, episodes=4).episodes == 4
    resume(out, steps=1024)


def test_one_is_switched_on_for_a_score_with_its_options(tmp_path: Path, drifting: PluginRegistry) -> None:
    out = tmp_path / "run"
    run(small_config("apl", steps=512), out=out, plugins=drifting)
    plain, far = (
        evaluate(out, episodes=40, plugins=drifting, observers=observers)
        for observers in ({}, {"drift": {"rate": 10.0}})
    )
    assert plain.observers == {}
    assert far.observers == {"drift": {"rate": 10.0}}
    assert far.causes != plain.causes or far.mean_length != plain.mean_length
    told = evaluate(
        out, episodes=40, plugins=drifting, observers={"drift": {}}, sets=["options.drift.rate=10.0"]
    )
    assert told.model_dump(exclude={"wall_seconds"}) == far.model_dump(exclude={"wall_seconds"})
    still = evaluate(out, episodes=40, plugins=drifting, observers={"drift": {"rate": 0.0}})
    assert (still.causes, still.mean_length) == (plain.causes, plain.mean_length)


def test_a_policy_without_a_run_meets_it_too(drifting: PluginRegistry) -> None:
    plain, far = (
        evaluate("random", episodes=40, plugins=drifting, env="toy-pursuit", observers=observers)
        for observers in ({}, {"drift": {"rate": 10.0}})
    )
    assert far.observers == {"drift": {"rate": 10.0}}
    assert far.mean_length != plain.mean_length


@pytest.mark.parametrize(
    ("options", "line"),
    [
        ({"observers": {"drft": {}}}, "unknown observer 'drft' (did you mean 'drift'?"),
        ({"observers": {"drift": {"rte": 1}}}, "options.drift.rte: unknown key (did you mean 'rate'?)"),
        (
            {"observers": {"drift": {}}, "sets": ["options.drift.rate=fast"]},
            "--set options.drift.rate=fast: ",
        ),
        ({"sets": ["options.drift.rate=1"]}, "--set options.drift.rate=1: options: unknown key"),
    ],
)
def test_mistakes_are_one_line(drifting: PluginRegistry, options: dict[str, Any], line: str) -> None:
    with pytest.raises(ApilError) as caught:
        evaluate("random", episodes=2, env="toy-pursuit", plugins=drifting, **options)
    assert line in str(caught.value)
    assert "\n" not in str(caught.value)


def test_one_that_is_on_already_is_not_switched_on_twice(tmp_path: Path, drifting: PluginRegistry) -> None:
    run(config(), out=tmp_path / "run", plugins=drifting)
    with pytest.raises(ApilError, match="has it switched on already"):
        evaluate(tmp_path / "run", episodes=2, plugins=drifting, observers={"drift": {}})


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"observers": ("drift", "drift")}, "observers.1: 'drift' is named twice"),
        ({"options": {"drift": {"rate": 1}}}, "options.drift: observer 'drift' is not switched on"),
        ({"observers": ("drft",)}, "observers.0: unknown observer 'drft' (did you mean 'drift'?"),
        (
            {"observers": ("drift",), "options": {"drift": {"rte": 1}}},
            "options.drift.rte: unknown key (did you mean",
        ),
    ],
)
def test_mistakes_in_a_configuration(drifting: PluginRegistry, changes: dict[str, Any], line: str) -> None:
    with pytest.raises(ApilError) as caught:
        complete(small_config("adrl", **changes), drifting)
    assert line in str(caught.value)


def test_it_meets_the_runs_methods_and_shares_no_name_with_one(drifting: PluginRegistry) -> None:
    import types

    from apil_core import ObserverSpec, hookimpl
    from apil_core.build import build

    attack = build(complete(small_config("apl", observers=("drift",)), drifting), drifting)
    attack.game.close()
    assert attack.hooks.plugins["drift"].knows == ["apl"]
    assert stored_and_read(attack.hooks.plugins["drift"].state_dict()) == {"steps": 1}
    module = types.ModuleType("thief")
    module.register_observers = hookimpl(lambda: [ObserverSpec("apl", "thief:Thief")])  # type: ignore[attr-defined]
    record = PluginRecord("thief", "", "test")
    drifting.add(record, module)
    assert record.error == "observer 'apl' has the name of a method: they share the section options"
