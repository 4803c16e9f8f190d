"""Registered observers in real runs: options, state, exact resume; and switched on for a score."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pytest
import torch
from helpers.small_runs import differences, small_config

from apil_core import ApilError, Observer, evaluate, resume, run
from apil_core.config.resolve import complete, load_resolved
from apil_core.plugins.discovery import PluginRecord, PluginRegistry, discover
from apil_core.training.plugin_state import stored_and_read
from apil_core.training.storage.run_dir import RunDir

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

DRAWN = '''
import torch
from apil_core import Observer, ObserverSpec, hookimpl

APIL_HOOK_API = 1


class Drawn(Observer):
    """Weights drawn at random when it is built, shown to the adversary; counted over the run's course."""

    def __init__(self, options, setup):
        super().__init__(options, setup)
        self.weight = torch.randn(3)
        self.heard = 0

    @hookimpl
    def extend_observation(self, context, view):
        return {"drawn": self.weight.expand(len(view.own), 3)}

    @hookimpl
    def iteration_finished(self, run, metrics):
        self.heard += 1

    def state_dict(self):
        return {"weight": self.weight, "heard": self.heard}

    def load_state_dict(self, state):
        self.weight, self.heard = state["weight"], state["heard"]


@hookimpl
def register_observers():
    return [ObserverSpec("drawn", f"{__name__}:Drawn")]
'''


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
    from apil_core.training.build import build

    attack = build(complete(small_config("apl", observers=("drift",)), drifting), drifting)
    attack.game.close()
    assert attack.hooks.plugins["drift"].knows == ["apl"]
    assert stored_and_read(attack.hooks.plugins["drift"].state_dict()) == {"steps": 1}
    module = types.ModuleType("thief")
    module.register_observers = hookimpl(lambda: [ObserverSpec("apl", "thief:Thief")])  # type: ignore[attr-defined]
    record = PluginRecord("thief", "", "test")
    drifting.add(record, module)
    assert record.error == "observer 'apl' has the name of a method: they share the section options"


@pytest.fixture
def drawing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    file = tmp_path / "drawing.py"
    file.write_text(DRAWN)
    monkeypatch.delitem(sys.modules, "drawing", raising=False)
    return file


def test_its_weights_depend_on_the_seed_alone_and_nobody_elses_on_it(drawing: Path) -> None:
    from apil_core.plugins.registry import make_game
    from apil_core.training.build import build_hooks, method_setup

    plugins = discover([drawing])
    game = make_game("toy-pursuit", num_envs=1)
    game.close()
    drawn, imitators = [], []
    for seed, observers, before in ((0, ("drawn",), 1), (0, ("drawn",), 2), (1, ("drawn",), 1), (0, (), 1)):
        config = complete(small_config("apil", seed=seed, observers=observers), plugins)
        torch.manual_seed(before)
        setup = method_setup(config, game.layout, 1, torch.device("cpu"))
        methods, hooks = build_hooks(config, plugins, setup)
        drawn += [observer.weight.tolist() for observer in hooks.of(Observer).values()]  # type: ignore[attr-defined]
        if before == 1 and seed == 0:
            imitators.append(stored_and_read(methods["apil"].state_dict()))
    assert drawn[0] == drawn[1] != drawn[2]
    assert differences(*imitators) == []


def test_it_goes_into_an_exported_file_and_a_victims_seat(tmp_path: Path, drawing: Path) -> None:
    from apil_core.training.export.export import export

    out = tmp_path / "run"
    run(small_config("adrl", observers=("drawn",), plugins=(str(drawing),), steps=1024), out=out)
    assert newest(out)["observers"]["drawn"]["heard"] == 2
    file = tmp_path / "adversary.safetensors"
    export(out, "safetensors", file)
    plugins = discover([drawing])
    score = evaluate(f"safetensors:{file}", episodes=10, env="toy-pursuit", plugins=plugins)
    own = evaluate(out, episodes=10)
    assert (score.causes, score.mean_length) == (own.causes, own.mean_length)
    again = small_config(
        "adrl", steps=1024, num_envs=16, init_from=out, observers=("drawn",), plugins=(str(drawing),)
    )
    run(again, out=tmp_path / "again")
    assert newest(tmp_path / "again")["observers"]["drawn"]["heard"] == 2 + 4


def test_a_checkpoint_without_its_state_is_refused(tmp_path: Path, drawing: Path) -> None:
    out = tmp_path / "run"
    run(small_config("adrl", observers=("drawn",), plugins=(str(drawing),), steps=512), out=out)
    path = RunDir(out).newest_checkpoint()
    state = torch.load(path, weights_only=True)
    del state["observers"]["drawn"]
    torch.save(state, path)
    for use in (lambda: evaluate(out, episodes=2), lambda: resume(out, steps=1024)):
        with pytest.raises(ApilError, match="plugin 'drawn': the checkpoint has no state of it"):
            use()


@pytest.mark.parametrize("observers", [({"drift": 1},), (["drift"],), (3,)])
def test_what_is_no_name_is_told_by_the_model(drifting: PluginRegistry, observers: Any) -> None:
    from apil_core.config.layers import Layer
    from apil_core.config.resolve import resolve_layers

    with pytest.raises(ApilError, match=r"observers.0: should be a valid string"):
        resolve_layers([Layer({"env": "toy-pursuit", "observers": list(observers)})], drifting)


@pytest.mark.parametrize("observers", [["drift"], {"drift": 3}])
def test_what_is_no_mapping_of_options_is_one_line(drifting: PluginRegistry, observers: Any) -> None:
    with pytest.raises(ApilError, match=r"observers(.drift)?: (must be a mapping|should be a section)"):
        evaluate("random", episodes=2, env="toy-pursuit", plugins=drifting, observers=observers)


def test_it_cannot_fill_what_only_one_method_opens(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from apil_core.training.build import build

    file = tmp_path / "paying.py"
    file.write_text(
        "from apil_core import Observer, ObserverSpec, hookimpl\n"
        "class Pays(Observer):\n    @hookimpl\n    def imitation_reward(self, rollout): return None\n"
        "@hookimpl\ndef register_observers(): return [ObserverSpec('pays', 'paying:Pays')]\n"
    )
    monkeypatch.delitem(sys.modules, "paying", raising=False)
    plugins = discover([file])
    config = complete(small_config("apil", observers=("pays",)), plugins)
    with pytest.raises(ApilError, match="plugin 'pays' cannot be used: unknown hook 'imitation_reward'"):
        build(config, plugins)


def test_it_cannot_be_named_like_a_plugin_that_is_one_itself(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "both.py"
    file.write_text(
        "from apil_core import ObserverSpec, hookimpl\n"
        "@hookimpl\ndef filter_observation(obs): return None\n"
        "@hookimpl\ndef register_observers(): return [ObserverSpec('both', 'both:Both')]\n"
    )
    monkeypatch.delitem(sys.modules, "both", raising=False)
    (record,) = [r for r in discover([file], forgiving=True).records if r.name == "both"]
    assert record.error == "observer 'both' has the name of a plugin that fills run hooks itself"


def test_a_score_from_before_they_were_told_was_played_with_the_runs(drifting: PluginRegistry) -> None:
    from apil_core.evaluation.results import with_observers_played

    config = complete(small_config("adrl", observers=("drift",)), drifting)
    score = evaluate("random", episodes=2, env="toy-pursuit", plugins=drifting)
    assert with_observers_played(score, config).observers == {}
    old = score.model_copy(update={"observers": None})
    assert with_observers_played(old, config).observers == {"drift": {"rate": 0.001}}


def test_an_option_may_be_set_as_a_whole_section(drifting: PluginRegistry) -> None:
    sets = ["options.drift={rate: 2.0}"]
    score = evaluate(
        "random", episodes=2, env="toy-pursuit", plugins=drifting, observers={"drift": {}}, sets=sets
    )
    assert score.observers == {"drift": {"rate": 2.0}}
