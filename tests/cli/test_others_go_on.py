"""One broken plugin or recorder: it is named, and listings, runs and other recorders are as without it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import pytest
from helpers.small_runs import metrics_of, small_config

from apil_core import GameSpec, run
from apil_core.api.specs import PolicySpec, RecorderSpec
from apil_core.plugins.default_victim import listings
from apil_core.plugins.discovery import PluginRecord, discover
from apil_core.training.storage.metrics_log import RowLog
from cli.cli_helpers import Apil

PLUGIN = """
from apil_core import GameSpec, MethodSpec, PolicyListing, PolicySpec, hookimpl
APIL_HOOK_API = 2
print("hello")

def rows():
    raise KeyError("[/b] gone")

@hookimpl
def register_games():
    print("hello again")
    return [GameSpec(name="odd-game", factory="x:y", summary="[/b] [red]", default_victim="odd:x",
                     fallback_victim="zero")]

@hookimpl
def register_methods():
    return [MethodSpec(name="odd-method", factory="x:y", summary="[/b]")]

@hookimpl
def register_policies():
    return [PolicySpec(scheme="odd", loader="x:y", lister="odd_plugin:rows")]
"""


def test_listings_survive_a_plugin(apil: Apil, tmp_path: Path) -> None:
    (tmp_path / "odd_plugin.py").write_text(PLUGIN)
    for verb in (("games",), ("methods",), ("plugins",), ("victims", "list")):
        done = apil(*verb, "--plugin", "odd_plugin.py")
        assert (done.code, "hello" in done.out) == (0, False), done.err
        assert json.loads(apil(*verb, "--plugin", "odd_plugin.py", "--json").out)
    listed = apil("victims", "list", "--plugin", "odd_plugin.py").out
    assert "odd:…" in listed
    assert "cannot be listed: '[/b] gone'" in listed
    assert "zoo:kick-and-defend/kicker/v1" in listed
    assert "[/b] [red]" in apil("games", "--plugin", "odd_plugin.py").out


def test_a_lister_gives_rows() -> None:
    rows = listings(PolicySpec("odd", "x:y", lister="os:getpid"))
    assert [(row.name, row.available) for row in rows] == [("odd:…", False)]


@pytest.mark.parametrize(
    ("spec", "reason"),
    [
        (GameSpec("g", "x:y", victim_side=5), "GameSpec 'g': victim_side: Input should be 0 or 1"),
        (GameSpec("g", "x:y", sides=("one",)), "GameSpec 'g': sides.1: Field required"),
        (GameSpec("g", "x:y", summary=None), "GameSpec 'g': summary: Input should be a valid string"),
        (GameSpec(3, "x:y"), "GameSpec 3: name: Input should be a valid string"),
    ],
)
def test_a_spec_with_an_impossible_value_is_its_plugins_fault(spec: GameSpec, reason: str) -> None:
    from types import ModuleType

    from apil_core import hookimpl

    plugin = ModuleType("a_plugin")
    plugin.APIL_HOOK_API = 2
    plugin.register_games = hookimpl(specname="register_games")(lambda: [spec])
    found = discover()
    known = list(found.games)
    found.add(PluginRecord("a_plugin", "", "here"), plugin)
    assert found.records[-1].error == reason
    assert list(found.games) == known


@pytest.mark.parametrize(
    "crash", ["class Odd(BaseException): pass\nraise Odd('no\\nway')", "raise GeneratorExit"]
)
def test_no_exception_of_a_plugin_ends_discovery(tmp_path: Path, crash: str) -> None:
    (tmp_path / "crashing_plugin.py").write_text(crash)
    found = discover([tmp_path / "crashing_plugin.py"], forgiving=True)
    assert found.records[-1].error in ("Odd: no way", "GeneratorExit: no message")
    assert "adrl" in found.methods


class Clearing:
    """Takes everything out of what it is handed, and cannot close."""

    def __init__(self, run_dir: Path):
        self.run_dir = run_dir

    def record(self, metrics: Mapping[str, float]) -> None:
        metrics.clear()  # type: ignore[attr-defined]

    def close(self) -> None:
        raise RuntimeError("cannot close")


def test_a_recorder_costs_neither_the_result_nor_the_other_recorders(tmp_path: Path) -> None:
    found = discover()
    found.recorders["clearing"] = RecorderSpec("clearing", f"{__name__}:Clearing")
    config = small_config("adrl").model_copy(update={"recorders": ("clearing", "jsonl")})
    result = run(config, out=tmp_path / "r", plugins=found)
    assert result.status == "finished"
    assert json.loads((tmp_path / "r" / "result.json").read_text())["status"] == "finished"
    rows = metrics_of(tmp_path / "r")
    assert rows[-1]["steps"] == result.steps


def test_all_recorders_are_closed_and_what_fails_is_told() -> None:
    notes: list[str] = []
    log = RowLog(
        [Clearing(Path()), Clearing(Path())], every=5, pending=[{"row_steps": 1.0}], note=notes.append
    )
    log.close()
    assert notes == ["recorder Clearing failed: cannot close"] * 2
