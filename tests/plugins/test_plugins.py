"""Discovery, isolation of broken plugins, requirements and blame."""

from __future__ import annotations

import types

import pytest

from apil_core.api.hooks import hookimpl
from apil_core.api.specs import MethodSpec, load
from apil_core.common.errors import PluginError, UnknownNameError
from apil_core.plugins.discovery import PluginRecord, PluginRegistry, discover
from apil_core.plugins.hook_manager import RunHookManager


def module(**functions):
    result = types.ModuleType("made_up")
    for name, function in functions.items():
        setattr(result, name, hookimpl(function))
    return result


def add(registry, name, plugin):
    record = PluginRecord(name, "1", "test")
    registry.add(record, plugin)
    return record


def offering(*specs):
    return module(register_methods=lambda: list(specs))


def test_built_ins_come_through_entry_points():
    registry = discover()
    assert [r for r in registry.records if r.error] == []
    assert {"adrl", "apl", "apil", "e_apil"} <= registry.methods.keys()
    assert "kick-and-defend" in registry.games
    assert all(r.origin.startswith("entry point") for r in registry.records)


def test_requirements_come_first():
    chain = discover().method_chain("e_apil")
    assert [spec.name for spec in chain] == ["apl", "apil", "e_apil"]


def test_unknown_method_suggests():
    with pytest.raises(UnknownNameError, match=r"unknown method 'e-apil' \(did you mean 'e_apil'"):
        discover().method_chain("e-apil")


@pytest.mark.parametrize(
    ("plugin", "reason"),
    [
        (module(register_method=lambda: []), "unknown hook 'register_method'"),
        (module(register_methods=lambda wrong: []), "wrong"),
        (module(register_methods=lambda: 1 / 0), "ZeroDivisionError"),
        (module(register_methods=lambda: ["apl"]), "must return MethodSpec objects"),
        (offering(MethodSpec("a", "m:C"), MethodSpec("a", "m:C")), "'a' twice"),
    ],
)
def test_a_broken_plugin_is_named_and_left_out(plugin, reason):
    registry = PluginRegistry()
    good = add(registry, "good", offering(MethodSpec("fine", "m:C")))
    bad = add(registry, "bad", plugin)
    assert good.error is None
    assert bad.error is not None
    assert reason in bad.error
    assert "\n" not in bad.error
    assert list(registry.methods) == ["fine"]


def test_strict_mode_raises(monkeypatch):
    monkeypatch.setenv("APIL_STRICT_PLUGINS", "1")
    with pytest.raises(PluginError, match="plugin 'bad' .* is broken: .*register_method"):
        add(PluginRegistry(), "bad", module(register_method=lambda: []))


def test_a_second_plugin_of_one_name_is_refused():
    registry = PluginRegistry()
    add(registry, "one", offering(MethodSpec("same", "m:C")))
    two = add(registry, "two", offering(MethodSpec("same", "m:C"), MethodSpec("other", "m:C")))
    assert two.error == "method 'same' is already offered by plugin 'one'"
    assert list(registry.methods) == ["same"]


def test_missing_and_circular_requirements():
    registry = PluginRegistry()
    add(
        registry,
        "p",
        offering(MethodSpec("a", "m:C", requires=("b",)), MethodSpec("b", "m:C", requires=("a",))),
    )
    with pytest.raises(PluginError, match="circle: a → b → a"):
        registry.method_chain("a")
    add(registry, "q", offering(MethodSpec("c", "m:C", requires=("gone",))))
    with pytest.raises(PluginError, match="'c' requires 'gone'"):
        registry.method_chain("c")


def test_one_file_plugin(tmp_path):
    file = tmp_path / "my_attack.py"
    file.write_text(
        "from apil_core import MethodSpec, hookimpl\n"
        "@hookimpl\n"
        "def register_methods():\n"
        "    return [MethodSpec('mine', 'my_attack:Mine')]\n"
    )
    registry = discover([file])
    assert registry.methods["mine"].factory == "my_attack:Mine"


def test_an_edited_one_file_plugin_is_imported_anew(tmp_path):
    """Twice within a second and of equal length, as in a notebook; Python's bytecode cache misses that."""
    file = tmp_path / "edited_between_runs.py"
    text = "class Weight:\n    value = 1\n"
    file.write_text(text)
    discover([file])
    first = load("edited_between_runs:Weight")
    discover([file])
    assert load("edited_between_runs:Weight") is first

    file.write_text(text.replace("1", "2"))
    discover([file])
    assert (first.value, load("edited_between_runs:Weight").value) == (1, 2)

    file.write_text("value = ")
    with pytest.raises(PluginError, match="invalid syntax"):
        discover([file])
    assert load("edited_between_runs:Weight").value == 2


@pytest.mark.parametrize(
    ("content", "reason"),
    [(None, "no such file"), ("import nowhere", "No module named 'nowhere'"), ("1 +", "SyntaxError")],
)
def test_a_broken_one_file_plugin_is_an_error(tmp_path, content, reason):
    file = tmp_path / "broken_attack.py"
    if content is not None:
        file.write_text(content)
    with pytest.raises(PluginError, match=reason) as caught:
        discover([file])
    assert str(file) in str(caught.value)


def test_a_hook_that_fits_nothing_names_its_plugin():
    class Misspelt:
        @hookimpl
        def shape_rewards(self, run, step):
            return {}

    with pytest.raises(PluginError, match="plugin 'mine' cannot be used: .*shape_rewards"):
        RunHookManager((), {"mine": Misspelt()})


def test_an_exception_in_a_hook_names_its_plugin():
    class Broken:
        @hookimpl
        def shape_reward(self, run, step):
            return helper()

    def helper():
        raise KeyError("lost")

    manager = RunHookManager((), {"mine": Broken()})
    with (
        pytest.raises(PluginError, match="plugin 'mine' failed in shape_reward: KeyError: 'lost'"),
        manager.attribution(),
    ):
        manager.hook.shape_reward(run=None, step=None)


def test_an_exception_of_ours_is_not_blamed_on_a_plugin():
    manager = RunHookManager((), {})
    with pytest.raises(ZeroDivisionError), manager.attribution():
        1 / 0


def test_two_plugins_may_not_use_one_name():
    class Pays:
        @hookimpl
        def shape_reward(self, run, step):
            return {"bonus": 1}

    manager = RunHookManager((), {"one": Pays(), "two": Pays()})
    with pytest.raises(PluginError, match=r"shape_reward \(filled by one, two\): 'bonus' is returned twice"):
        manager.merged([{"bonus": 1}, {"bonus": 2}], "shape_reward")


def test_answers_merge_in_registration_order():
    assert list(RunHookManager((), {}).merged([{"last": 1}, {"first": 2}], "x")) == ["first", "last"]
