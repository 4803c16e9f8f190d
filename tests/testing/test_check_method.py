"""check_method: the built-in methods pass, and every check has a plugin that fails it."""

from __future__ import annotations

import types
from pathlib import Path

import pytest
import torch

import testing.broken_methods as broken_methods
from apil_core import MethodSpec, UnknownNameError, View
from apil_core.plugins.discovery import PluginRecord, discover
from apil_core.testing import ContractError, MethodReport, check_method
from apil_core.testing.checks import METHOD_CHECKS
from apil_core.testing.hook_spy import Call, HookSpy, spied_hooks
from apil_core.testing.method_calls import check_calls, expected_calls
from apil_core.testing.method_play import check_export, check_playing
from apil_core.testing.method_runs import (
    check_companions,
    check_other_seed,
    check_resume,
    check_same_seed,
    check_sizes,
    watched_run,
)
from apil_core.testing.method_spec import check_import
from apil_core.testing.method_under_test import MethodUnderTest, find
from apil_core.testing.methods import without_a_run
from testing.broken_methods import IN_ONE_CALL, OPTIONS, WATCHED, WITHOUT_A_RUN, method


@pytest.fixture(autouse=True)
def _own_random_numbers():
    with torch.random.fork_rng(devices=[]):
        yield


def under_test(name: str, **more) -> MethodUnderTest:
    return find(method(name, **more), (), None, "toy-pursuit")


def says(caught, address: str, text: str) -> None:
    message = str(caught.value)
    assert "method 'bad'" in message
    assert text in message
    assert message.endswith(f"\n  docs: {address}")
    assert f"\n  contract: {caught.value.check.text}\n" in message


# --- methods that are sound


def test_adrl_passes_every_check() -> None:
    report = check_method("adrl")
    assert report.checked == [check.title for check in METHOD_CHECKS.values()]
    assert report.skipped == []
    assert str(report).splitlines()[1] == "  fills no hook"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "options", "hooks"),
    [
        ("apl", None, {"shape_reward": 32, "finish_rollout": 4, "combine_advantages": 4}),
        ("apl", {"advantage_difference": True}, {"shape_reward": 32, "finish_rollout": 4}),
        ("apil", None, {"extend_observation": 33, "update_auxiliary": 4, "imitation_reward": 4}),
        ("apil", {"prediction": "noise"}, {"extend_observation": 33}),
        ("apil", {"prediction": "oracle", "share_victim_observation": True}, {"extend_observation": 33}),
        ("apil", {"rollouts": "own", "imitator": {"update": "ppo"}}, {"imitation_reward": 2}),
        ("e_apil", None, {"imitation_streams": 4}),
    ],
)
def test_the_other_methods_pass_every_check(name: str, options, hooks: dict[str, int]) -> None:
    report = check_method(name, options=options)
    calls = {cost.hook: cost.calls for cost in report.hooks}
    assert {hook: calls[hook] for hook in hooks} == hooks
    assert all(hook in str(report) for hook in hooks)


def test_a_report_is_a_short_table() -> None:
    from apil_core.testing.reports import HookCost

    costs = [HookCost("shape_reward", 32, "step", 5e-5), HookCost("update_auxiliary", 4, "rollout", 0.02)]
    report = MethodReport("mine", "toy-pursuit", ["Spec"], ["light import: why"], costs, 0.00255, 6, 1.0)
    assert str(report).splitlines() == [
        "method mine on toy-pursuit: 1 checks passed (1.0 s)",
        "  hook              calls               ms a call",
        "  shape_reward      32     per step     0.050",
        "  update_auxiliary  4      per rollout  20.000",
        "  all hooks: 2.550 ms per vectorised step of 6 games",
        "  not checked: light import: why",
    ]


# --- broken before a run


@pytest.mark.parametrize(
    ("spec", "text"),
    [
        (MethodSpec("bad", "no_such_module:Bad"), "cannot load 'no_such_module:Bad'"),
        (method("Open"), "must be a Method, got Open"),
        (method("WATCHED"), "must give a Method, got list"),
        (method("Crashes", summary="two\nlines"), "summary must be one line"),
        (method("Crashes", requires=("nobody",)), "requires 'nobody', which no working plugin offers"),
        (method("Crashes", requires=("apl", "apl")), "requires names a method twice"),
        (MethodSpec("a.bad", "x:y"), "name 'a.bad' cannot stand in options.<name>.<key>"),
    ],
)
def test_a_spec_that_is_not_sound(spec: MethodSpec, text: str) -> None:
    with pytest.raises(ContractError) as caught:
        check_method(spec)
    assert text in str(caught.value)
    assert caught.value.address == "testing.md#spec"


def test_hookspecs_without_any() -> None:
    with pytest.raises(ContractError, match="has no function marked with apil_core.hookspec") as caught:
        check_method(method("Crashes", hookspecs="helpers.small_runs"))
    assert caught.value.address == "hooks.md#hooks-of-your-own"


@pytest.mark.parametrize(("model", "text"), OPTIONS)
def test_options_that_are_not_sound(model: str, text: str) -> None:
    with pytest.raises(ContractError) as caught:
        check_method(method("Crashes", config=f"{broken_methods.__name__}:{model}"))
    says(caught, "testing.md#options-model", text)


@pytest.mark.parametrize(("name", "address", "text"), WITHOUT_A_RUN)
def test_what_is_found_before_a_run(name: str, address: str, text: str) -> None:
    with pytest.raises(ContractError) as caught:
        without_a_run(under_test(name))
    says(caught, address, text)


def test_a_module_that_imports_mujoco(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "heavy_plugin.py").write_text("import mujoco\n")
    monkeypatch.syspath_prepend(tmp_path)
    registry, bad = discover(), MethodUnderTest("bad", "toy-pursuit", None)
    registry.records.append(PluginRecord("heavy", "", "entry point heavy_plugin", methods=("bad",)))
    registry.modules["heavy"] = types.ModuleType("heavy_plugin")
    with (
        pytest.raises(ContractError, match="import heavy_plugin brings in mujoco") as caught,
        bad.check("import"),
    ):
        check_import(bad, registry, "methods", "bad")
    says(caught, "hooks.md#register_methods", "import those where they are used")


def test_a_plugin_that_does_not_import(tmp_path: Path, apil_files: None) -> None:
    (tmp_path / "torn.py").write_text("import apil_core.nothing\n")
    with pytest.raises(ContractError, match="torn.py: .*No module named 'apil_core.nothing'"):
        check_method("bad", plugins=[tmp_path / "torn.py"])


def test_a_name_that_nobody_offers() -> None:
    with pytest.raises(UnknownNameError, match="unknown method 'apal' .did you mean 'ap"):
        check_method("apal")


# --- broken in a run


@pytest.mark.parametrize(("name", "check", "hook", "text"), IN_ONE_CALL)
def test_what_the_watch_sees_in_one_call(name: str, check: str, hook: str, text: str) -> None:
    spy = HookSpy()
    hooks = spied_hooks(spy)([], {"bad": getattr(broken_methods, name)(None, None)})
    given = {
        "extend_observation": {
            "context": None,
            "view": View(torch.ones(2, 3), torch.ones(2, 3), torch.ones(2)),
        },
        "iteration_finished": {"run": None, "metrics": {"steps": 1.0}},
        "combine_advantages": {"run": None, "rollout": None, "streams": {"reward": torch.ones(4, 2)}},
        "shape_reward": {"run": None, "step": types.SimpleNamespace(reward=torch.ones(2))},
        "update_auxiliary": {
            "run": None,
            "rollout": None,
            "successors": None,
            "victim_successors": None,
        },
    }
    getattr(hooks.hook, hook)(**given[hook])
    (mistake,) = spy.mistakes
    assert (mistake.check, mistake.hook) == (check, hook)
    assert mistake.text == f"{hook} (filled by bad) {text}"
    (call,) = spy.calls
    assert (call.hook, call.plugins, call.within) == (hook, ("bad",), ())


@pytest.mark.parametrize(("name", "address", "text"), WATCHED)
def test_what_the_watched_run_finds(tmp_path: Path, name: str, address: str, text: str) -> None:
    with pytest.raises(ContractError) as caught:
        watched_run(under_test(name), tmp_path / "r")
    says(caught, address, text)


def test_a_hook_that_is_never_called(tmp_path: Path) -> None:
    bad = under_test("FillsWhatNobodyCalls", hookspecs=broken_methods.__name__)
    run = watched_run(bad, tmp_path / "r")
    with pytest.raises(ContractError) as caught:
        check_calls(bad, run)
    says(caught, "hooks.md#hooks-of-your-own", "bad_hook is filled but was never called")


def test_a_call_out_of_order_is_told() -> None:
    fillers = {"shape_reward": ["a"], "update_auxiliary": ["a", "b"], "filter_observation": ["b"]}
    calls = expected_calls(fillers, rollouts=1, steps=2)
    look = ["filter_observation of b"] * 2
    step = ["shape_reward", *look]
    assert calls == [*look, *step, *step, "update_auxiliary of a", "update_auxiliary of b"]


@pytest.mark.slow
def test_a_run_with_a_call_too_many(tmp_path: Path) -> None:
    bad = find("apl", (), None, "toy-pursuit")
    run = watched_run(bad, tmp_path / "r")
    run.spy.calls.insert(3, Call("finish_rollout", ("apl",)))
    with pytest.raises(
        ContractError, match="call 4 of the run was finish_rollout, expected was shape_reward"
    ):
        check_calls(bad, run)


@pytest.mark.slow
def test_a_seed_that_does_not_decide(tmp_path: Path) -> None:
    bad = under_test("RemembersRuns")
    with pytest.raises(ContractError) as caught:
        check_same_seed(bad, watched_run(bad, tmp_path / "r"), tmp_path / "again")
    says(caught, "testing.md#seeds", "two runs of one seed differ in ")


def test_a_seed_that_is_not_heard() -> None:
    with pytest.raises(ContractError) as caught:
        check_other_seed(under_test("SeedsTorch"))
    says(caught, "testing.md#seeds", "seeds 0 and 1 begin with the same policy")


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("ForgetsItsCount", "after a resume these differ: "),
        pytest.param(
            "ForgetsForTheLog",
            "after a resume these metrics differ: bad/count",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_a_state_that_lacks_something(tmp_path: Path, name: str, text: str) -> None:
    bad = under_test(name)
    with pytest.raises(ContractError) as caught:
        check_resume(bad, watched_run(bad, tmp_path / "r"), tmp_path / "resumed")
    says(caught, "testing.md#resume", text)


@pytest.mark.parametrize(
    ("name", "address", "text"),
    [
        ("CarriesOver", "testing.md#without-a-run", "a new game depends on the game before it"),
        ("RefusesTheBlind", "hooks.md#extend_observation", "ValueError: all opponents are alike"),
    ],
)
@pytest.mark.slow
def test_an_adversary_that_cannot_play(tmp_path: Path, name: str, address: str, text: str) -> None:
    bad = under_test(name)
    with pytest.raises(ContractError) as caught:
        check_playing(bad, watched_run(bad, tmp_path / "r"))
    says(caught, address, text)


def test_what_cannot_be_exported_as_a_network_is_said(tmp_path: Path) -> None:
    """No network has the number of games as a Python number."""
    odd = under_test("CountsGames")
    run = watched_run(odd, tmp_path / "r")
    check_export(odd, run)
    assert [text.split(":")[1].strip() for text in odd.skipped] == ["torchscript", "onnx"]
    assert all("no fixed network of tensor operators" in text for text in odd.skipped)
    assert (run.out / "adversary.safetensors").exists()


def test_a_file_that_does_not_act_as_the_adversary(tmp_path: Path) -> None:
    bad = under_test("KnowsItsNumber")
    run = watched_run(bad, tmp_path / "r")
    with pytest.raises(ContractError) as caught:
        check_export(bad, run)
    says(caught, "testing.md#export", "the exported file does not act as the run does")


@pytest.mark.parametrize(
    ("name", "title", "text"),
    [
        ("NormalisesOverGames", "One game", "'z' must be finite, got NaN"),
        ("CountsOn32Games", "Many games", "must match the size of tensor"),
    ],
)
def test_a_number_of_games_it_did_not_expect(tmp_path: Path, name: str, title: str, text: str) -> None:
    with pytest.raises(ContractError) as caught:
        check_sizes(under_test(name), tmp_path)
    says(caught, "hooks.md#shape_reward", text)
    assert caught.value.check.title == title


@pytest.mark.parametrize(
    ("name", "address", "text"),
    [
        ("DropsOthers", "hooks.md#shape_reward", "shape_reward: what another plugin answers is lost"),
        ("CountsOnOneStream", "hooks.md#combine_advantages", "too many values to unpack"),
    ],
)
def test_bad_company(tmp_path: Path, name: str, address: str, text: str) -> None:
    with pytest.raises(ContractError) as caught:
        check_companions(under_test(name), tmp_path / "r")
    says(caught, address, text)
    assert caught.value.check.title == "Companions"
