"""The section `game`: what naming a physics profile does to the layers below, and what options come to."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar

import pytest

from apil_core import ConfigError, GameSpec, Matchup, ProfiledOptions, RunConfig
from apil_core.config.game import overlaid, spelt_out, with_game_options
from apil_core.config.resolve import resolve
from apil_core.evaluation.fidelity.plan import plan_rows, switches
from apil_core.evaluation.options import FidelityOptions
from apil_core.plugins.discovery import PluginRegistry


@dataclass(frozen=True)
class Sand:
    grain: int
    wet: bool


class SandOptions(ProfiledOptions):
    profiles: ClassVar[Mapping[str, Sand]] = {"faithful": Sand(1, True), "fast": Sand(9, False)}

    size: int = 3
    grain: int | None = None
    wet: bool | None = None


@pytest.fixture
def sand(registry: PluginRegistry, monkeypatch: pytest.MonkeyPatch) -> PluginRegistry:
    """The made-up game of this folder, and one with profiles."""
    module = ModuleType("sand_game")
    module.SandOptions = SandOptions  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "sand_game", module)
    spec = GameSpec("sand", "sand_game:Game", config="sand_game:SandOptions", matchups=(Matchup("a", "v"),))
    registry.games["sand"] = spec
    return registry


def played(registry: PluginRegistry, *sets: str, file: Path | None = None, **flags: Any) -> dict[str, Any]:
    config = resolve(file, sets=["env=sand", *sets], flags=flags, plugins=registry)
    made = SandOptions(**config.game).settings
    return {**made, "size": config.game["size"]}


FAITHFUL = {"physics": "faithful", "grain": 1, "wet": True, "size": 3}
FAST = {"physics": "fast", "grain": 9, "wet": False, "size": 3}


# --- layers


def test_a_profile_by_flag_and_by_set(sand: PluginRegistry) -> None:
    assert played(sand) == FAITHFUL
    assert played(sand, "game.physics=fast") == FAST
    assert played(sand, **{"game.physics": "fast"}) == FAST
    assert played(sand, "game.physics=faithful", **{"game.physics": "fast"}) == FAITHFUL  # --set wins


def test_a_profile_hides_the_single_values_of_a_file_but_no_other_option(
    sand: PluginRegistry, tmp_path: Path
) -> None:
    file = tmp_path / "a.yaml"
    file.write_text("game: {grain: 4, size: 5}\n")
    assert played(sand, file=file) == {"physics": "custom", "grain": 4, "wet": True, "size": 5}
    assert played(sand, file=file, **{"game.physics": "fast"}) == {**FAST, "size": 5}
    assert played(sand, "game.physics=faithful", file=file) == {**FAITHFUL, "size": 5}


def test_single_values_beside_or_above_the_profile_stay(sand: PluginRegistry, tmp_path: Path) -> None:
    custom = {**FAST, "physics": "custom", "grain": 4}
    file = tmp_path / "a.yaml"
    file.write_text("game: {grain: 4, physics: fast}\n")
    assert played(sand, file=file) == custom
    file.write_text("game: {physics: fast}\n")
    assert played(sand, "game.grain=4", file=file) == custom
    # flags and --set are one layer, whichever comes first
    assert played(sand, "game.grain=4", **{"game.physics": "fast"}) == custom
    assert played(sand, "game.grain=4", "game.physics=fast") == custom


def test_a_game_without_profiles_says_so_in_one_line(registry: PluginRegistry) -> None:
    for sets, flags, origin in (
        ([], {"game.physics": "fast"}, "--physics fast"),
        (["game.physics=fast"], {}, "--set game.physics=fast"),
    ):
        with pytest.raises(ConfigError) as caught:
            resolve(sets=sets, flags=flags, plugins=registry)
        assert str(caught.value) == f"{origin}: game kick-and-defend has no physics profiles"


def test_a_wrong_profile_or_value_is_one_line(sand: PluginRegistry) -> None:
    with pytest.raises(ConfigError) as caught:
        played(sand, "game.physics=fats")
    assert str(caught.value) == (
        "--set game.physics=fats: should be 'faithful' or 'fast', got 'fats' (did you mean 'fast'?)"
    )
    with pytest.raises(ConfigError, match="whole number"):
        played(sand, "game.grain=many", **{"game.physics": "fast"})


# --- one stored run, played otherwise


@pytest.mark.parametrize(
    ("how", "expected"),
    [
        ({}, {"physics": "custom", "grain": 4, "wet": False}),
        ({"physics": "faithful"}, {"physics": "faithful", "grain": 1, "wet": True}),
        ({"sets": ["game.physics=faithful"]}, {"physics": "faithful", "grain": 1, "wet": True}),
        ({"options": {"physics": "faithful"}}, {"physics": "faithful", "grain": 1, "wet": True}),
        ({"physics": "faithful", "sets": ["game.grain=2"]}, {"physics": "custom", "grain": 2, "wet": True}),
        ({"physics": "fast", "sets": ["game.physics=faithful"]}, {"physics": "faithful", "grain": 1}),
        ({"sets": ["game.wet=true"]}, {"physics": "custom", "grain": 4, "wet": True}),
    ],
)
def test_a_profile_asked_for_is_really_played(
    sand: PluginRegistry, how: dict[str, Any], expected: dict[str, Any]
) -> None:
    run = RunConfig(env="sand", game={"physics": "fast", "grain": 4, "wet": None, "size": 6})
    config = with_game_options(run, sand, **how)
    settings = SandOptions(**config.game).settings
    assert {key: settings[key] for key in expected} == expected
    assert config.game["size"] == 6
    assert run.game["grain"] == 4


def test_options_that_mean_the_same_are_spelt_the_same(sand: PluginRegistry) -> None:
    old, new = {"grain": 1, "wet": True, "size": 3}, {"physics": "faithful", "grain": None}
    assert spelt_out("sand", old, sand) == spelt_out("sand", new, sand) == FAITHFUL
    assert spelt_out("kick-and-defend", {}, sand) == {"margin": 0.5}


def test_options_over_options(sand: PluginRegistry) -> None:
    base = {"physics": "faithful", "grain": 4, "size": 6}
    assert overlaid(SandOptions, base, {"physics": "fast"}) == {"physics": "fast", "size": 6}
    assert overlaid(SandOptions, base, {"grain": 5}) == {**base, "grain": 5}


# --- fidelity


def rows(sand: PluginRegistry, **request: Any) -> list[tuple[str, str, dict[str, Any]]]:
    plan = plan_rows([sand.games["sand"]], FidelityOptions(**request), lambda name: None)
    return [(row.kind, row.setting.partition(", ")[0], row.options) for row in plan.rows]


def test_every_row_in_a_profile(sand: PluginRegistry) -> None:
    assert rows(sand) == rows(sand, physics="faithful") == [("default", "sampled/sampled", {})]
    assert rows(sand, physics="fast") == [("profile", "sampled/sampled", {"physics": "fast"})]
    switched = rows(sand, physics="fast", switches=True)
    assert ("switch", "mode/mode", {"physics": "fast"}) in switched
    assert ("switch", "sampled/sampled", {"physics": "fast", "wet": True}) in switched
    variants = [{"grain": 2}, {"physics": "faithful"}, {"grain": 9}]
    assert rows(sand, physics="fast", variants=variants) == [
        ("profile", "sampled/sampled", {"physics": "fast"}),
        ("variant", "sampled/sampled", {"physics": "fast", "grain": 2}),
        ("variant", "sampled/sampled", {}),  # grain 9 is what fast says: no row of its own
    ]


def test_the_profile_is_a_switch_and_null_is_none(sand: PluginRegistry) -> None:
    options = [switch for switch in switches(SandOptions) if not set(switch) & {"adversary_actions"}]
    assert options == [{"physics": "fast"}, {"wet": False}]
    assert {"wet": True} in switches(SandOptions, "fast")
    assert {"physics": "faithful"} in switches(SandOptions, "fast")


def test_games_without_profiles_are_skipped(sand: PluginRegistry) -> None:
    plain = replace(sand.games["kick-and-defend"], matchups=(Matchup("a", "v"),))
    plan = plan_rows([plain, sand.games["sand"]], FidelityOptions(physics="fast"), lambda name: None)
    assert [row.env for row in plan.rows] == ["sand"]
    assert [skipped.reason for skipped in plan.skipped] == ["game kick-and-defend has no physics profiles"]
