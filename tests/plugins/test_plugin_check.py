"""Versions and ends of hooks, ``apil plugins --check``, and what is looked for around a run's hooks."""

from __future__ import annotations

import json
import sys
import warnings
from collections import OrderedDict, namedtuple
from contextlib import nullcontext

import numpy as np
import pluggy
import pytest
import torch
from helpers.small_runs import differences, small_config

from apil_core import HOOK_API, Deprecation, Method, PluginError, hookimpl, hookspec
from apil_core.api.hook_api import HookDeprecationWarning, version_in_source
from apil_core.api.hooks import PROJECT
from apil_core.api.hookspecs import RunHooks
from apil_core.config.resolve import complete
from apil_core.plugins.check import check_plugins
from apil_core.plugins.discovery import PluginRecord, PluginRegistry, discover
from apil_core.plugins.hook_manager import RunHookManager
from apil_core.plugins.registry import default_plugins
from apil_core.plugins.validation import forgotten, register, remarks
from apil_core.training.build import build
from apil_core.training.plugin_state import unstorable
from apil_core.training.storage.checkpoint import to_tensors
from apil_core.training.trainer import Trainer

HEAD = "from apil_core import GameSpec, Method, MethodSpec, hookimpl\n"


@pytest.fixture
def checked(tmp_path):
    """Reports by name, for a one-file plugin ``looked_at`` of that source; it is forgotten afterwards."""

    def check(source):
        file = tmp_path / "looked_at.py"
        file.write_text(HEAD + source)
        return {report.name: report for report in check_plugins(discover([file], forgiving=True))}

    yield check
    sys.modules.pop("looked_at", None)


def offering(spec, body="pass"):
    made = f"class Made(Method):\n    {body}\n"
    return f"{made}@hookimpl\ndef register_methods():\n    return [MethodSpec({spec})]\n"


# --- apil plugins --check


def test_what_is_built_in_works_and_states_the_version_offered_here(checked):
    reports = checked("")
    built_in = {"adrl", "apl", "apil", "e_apil", "foreign", "games", "pettingzoo", "recorders", "zoo"}
    assert built_in <= reports.keys()
    for name in built_in:
        assert (reports[name].hook_api, reports[name].broken, reports[name].remarks) == (HOOK_API, (), ())


@pytest.mark.parametrize(
    ("source", "reason"),
    [
        (
            offering('"m", "looked_at:Made"', "@hookimpl\n    def shape_rewards(self, run): return {}"),
            "plugin 'm' cannot be used: unknown hook 'shape_rewards' (did you mean 'shape_reward'?)",
        ),
        (offering('"m", "gone:Made"'), "method 'm': cannot load 'gone:Made': No module named 'gone'"),
        (
            offering('"m", "looked_at:Made", config="looked_at:Made"'),
            "method 'm': looked_at:Made must be a pydantic model, got Made",
        ),
        (
            offering('"m", "looked_at:Made", requires=("apll",)'),
            "method 'm' requires 'apll', which no working plugin offers",
        ),
        (
            offering('"m", "looked_at:MethodSpec"'),
            "looked_at:MethodSpec must be a Method, got MethodSpec",
        ),
        (
            "@hookimpl\ndef register_games():\n    return [GameSpec('g', 'looked_at:HEAD')]\n",
            "game 'g': factory: cannot load 'looked_at:HEAD': module 'looked_at' has no attribute 'HEAD'",
        ),
    ],
)
def test_what_breaks_only_in_a_run_is_found_without_one(checked, source, reason):
    report = checked(source)["looked_at"]
    assert [line.removeprefix("plugin 'm': ") for line in report.broken] == [reason]


def test_hooks_opened_by_what_is_required_are_known(checked):
    body = "@hookimpl\n    def imitation_reward(self, rollout): return rollout.reward"
    report = checked(offering('"m", "looked_at:Made", requires=("apil",)', body))["looked_at"]
    assert report.broken == ()
    assert report.remarks == ("states no hook API version: add APIL_HOOK_API = 2 beside its hooks",)


def test_a_method_that_is_a_torch_module_does_not_stop_the_check(checked):
    source = offering('"m", "looked_at:Both"') + "import torch\nclass Both(torch.nn.Module, Method): pass\n"
    report = checked(source)["looked_at"]
    assert report.broken == ()
    assert any("its run hooks show in" in remark for remark in report.remarks)


def test_the_verb_tells_broken_ones_by_its_exit_code(tmp_path, monkeypatch, capsys):
    from apil_core.cli import main

    monkeypatch.chdir(tmp_path)
    (tmp_path / "newer.py").write_text("APIL_HOOK_API = 7")
    with pytest.raises(SystemExit) as caught:
        main(["plugins", "--check", "--json", "--plugin", "newer.py"])
    (row,) = [row for row in json.loads(capsys.readouterr().out) if row["name"] == "newer"]
    assert (caught.value.code, row["hook_api"]) == (1, 7)
    assert row["broken"] == [
        "built for hook API 7, this APIL offers 2: upgrade apil, or install an older newer"
    ]


# --- versions and ends


@pytest.mark.parametrize(
    ("source", "version"),
    [
        ("import nowhere\nAPIL_HOOK_API = 3", 3),
        ("APIL_HOOK_API: int = 2", 2),
        ("APIL_HOOK_API = True", None),
        ("if x:\n    APIL_HOOK_API = 2", None),
        ("def", None),
    ],
)
def test_the_version_is_read_without_importing(tmp_path, source, version):
    (tmp_path / "p.py").write_text(source)
    assert version_in_source(tmp_path / "p.py") == version


class OldHooks:
    @hookspec(since=1, deprecated=Deprecation(since=2, removed_in=4, instead="fill run_started"))
    def old(self, run): ...

    @hookspec(deprecated_arguments={"step": Deprecation(since=2, removed_in=3, instead="take run")})
    def kept(self, run, step): ...


class Fills:
    @hookimpl
    def old(self): ...

    @hookimpl
    def kept(self, step): ...


def test_a_deprecation_warns_as_pluggy_does_and_is_told_in_a_run():
    manager = pluggy.PluginManager(PROJECT)
    manager.add_hookspecs(OldHooks)
    plugin = Fills()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        register(manager, "mine", plugin)
    lines = [
        "argument 'step' of hook 'kept' is deprecated since hook API 2 and gone in 3: take run",
        "hook 'old' is deprecated since hook API 2 and gone in 4: fill run_started",
    ]
    assert sorted(str(warning.message) for warning in caught) == lines
    assert {warning.category for warning in caught} == {HookDeprecationWarning}
    assert remarks(manager, "mine", plugin) == lines


# --- forgotten answers


class Silent:
    @hookimpl
    def shape_reward(self, step):
        def inner():
            return step

        inner()

    @hookimpl
    def finish_rollout(self, rollout) -> None:
        """Says that it answers nothing."""

    @hookimpl
    def extend_observation(self, view):
        raise NotImplementedError

    @hookimpl(wrapper=True)
    def combine_advantages(self):
        return (yield)

    @hookimpl
    def update_auxiliary(self):
        """Trains, and has nothing to report."""

    @hookimpl
    def run_started(self):
        """Is not asked for an answer."""


def test_only_an_answer_that_is_wanted_can_be_forgotten():
    manager = pluggy.PluginManager(PROJECT)
    manager.add_hookspecs(RunHooks)
    register(manager, "silent", Silent())
    assert [line.split()[0] for line in forgotten(manager, "silent")] == ["shape_reward"]


# --- arguments unchanged


def test_comparing_arguments_changes_nothing_and_ends():
    states = []
    for watched in (True, False):
        config = complete(small_config("e_apil"), default_plugins())
        trainer = Trainer(build(config, default_plugins()), default_plugins())
        with trainer.attack.hooks.arguments_unchanged() if watched else nullcontext():
            trainer.iterate()
        trainer.iterate()
        states.append(to_tensors(trainer.state_dict()))
    assert differences(*states) == []


def test_a_hook_that_fails_is_not_blamed_for_what_it_changed_before():
    class Fails:
        @hookimpl
        def filter_observation(self, obs):
            obs.zero_()
            raise KeyError("lost")

    class Changes:
        @hookimpl
        def filter_observation(self, obs):
            obs.zero_()

    given = {"context": None, "side": 0}
    hooks = RunHookManager((), {"mine": Fails()})
    with hooks.arguments_unchanged(), pytest.raises(KeyError, match="lost"):
        hooks.hook.filter_observation(obs=torch.ones(2), **given)
    hooks = RunHookManager((), {"mine": Changes()})
    changed = r"filter_observation \(filled by mine\): changed obs in place"
    with hooks.arguments_unchanged(), pytest.raises(PluginError, match=changed):
        hooks.hook.filter_observation(obs=torch.ones(2), **given)
    hooks.hook.filter_observation(obs=torch.ones(2), **given)  # outside, nobody looks


def test_what_a_hook_returns_loses_its_graph_and_must_live_where_the_run_does():
    hooks = RunHookManager((), {})
    weight = torch.ones(3, requires_grad=True)
    assert not hooks.checked("shape_reward", "b", 2 * weight, (3,)).requires_grad
    hooks.device = torch.device("cuda", 0)
    with pytest.raises(PluginError, match="'b' must be on cuda:0, got one on cpu"):
        hooks.checked("shape_reward", "b", weight, (3,))


# --- states


class Other(Method):
    """Something no checkpoint reads back."""


Pair = namedtuple("Pair", "a b")


@pytest.mark.parametrize(
    ("state", "where"),
    [
        ({"w": torch.ones(2), "n": {"deep": [1, 2.5, "x", None, True]}}, None),
        ({"w": torch.nn.Parameter(torch.ones(2)), 3: OrderedDict(a=[1.0])}, None),
        (torch.optim.Adam([torch.nn.Parameter(torch.ones(1))]).state_dict(), None),
        ({"a": [0, {"b": Other}]}, ("s['a'][1]['b']", "type")),
        ({"a": np.ones(2)}, ("s['a']", "numpy array")),
        ({"a": [np.float32(1)]}, ("s['a'][0]", "numpy number")),
        ({"a": Pair(1, 2)}, ("s['a']", "Pair")),
        ({(1, 2): 0}, None),
        ({Other: 0}, (f"s: key {Other!r}", "type")),
    ],
)
def test_what_a_checkpoint_cannot_hold_is_found(state, where):
    assert unstorable(state, "s") == where


@pytest.mark.parametrize("crash", ["raise RuntimeError('no GL')", "1 / 0", "raise SystemExit(3)"])
def test_a_package_that_crashes_while_its_plugin_is_looked_for_hides_no_other(tmp_path, monkeypatch, crash):
    package = tmp_path / "crashing_package"
    package.mkdir()
    (package / "__init__.py").write_text(crash)
    (package / "plugin.py").write_text("APIL_HOOK_API = 1\n")
    monkeypatch.syspath_prepend(tmp_path)
    registry = PluginRegistry()
    record = PluginRecord("bad", "1", "entry point crashing_package.plugin")
    registry.add_failure(record, RuntimeError("no GL"), "crashing_package.plugin")
    assert record.error == "RuntimeError: no GL"
