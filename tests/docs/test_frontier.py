"""The tables and the picture of physics settings, made from invented rows: no number here is a result."""

from __future__ import annotations

import json
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from apil_core.common.errors import ConfigError
from apil_core.evaluation.fidelity.plan import RowPlan
from apil_core.evaluation.fidelity.rows import FidelityRow
from apil_core.evaluation.results import EvaluationResult, wilson
from docs.pages import ROOT

A, V = "zoo:sumo-ants/fighter/v2", "zoo:sumo-ants/fighter/v1"
FAST = {"solver": "Newton", "integrator": "leapfrog", "timestep": 0.003, "substeps": 5, "refresh": False}
TRUE = {"solver": "PGS", "integrator": "RK4", "timestep": 0.003, "substeps": 5}
"""As scores stored it before there were profiles."""


@pytest.fixture
def frontier(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(ROOT / "docs"))
    import frontier

    return frontier


@pytest.fixture
def make_frontier(frontier: ModuleType) -> ModuleType:
    import make_frontier

    return make_frontier


def row(
    wins: int, ties: int, games: int, options: dict[str, Any], settings: dict[str, Any], seed: int = 0
) -> FidelityRow:
    shares = {"win": wins, "tie": ties, "loss": games - wins - ties, "win_or_tie": wins + ties}
    how: dict[str, Any] = {"adversary_actions": "sample", "victim_actions": "sample", "seed": seed}
    plan = RowPlan(
        env="sumo-ants", adversary=A, victim=V, kind="variant", episodes=games, num_envs=8, options={}, **how
    )
    result = EvaluationResult(
        env="sumo-ants",
        adversary={"name": A, "sha256": ""},  # type: ignore[arg-type]
        victim={"name": V, "sha256": ""},  # type: ignore[arg-type]
        adversary_side="fighter_1",
        victim_side="fighter_0",
        num_envs=8,
        game_options=options,
        game_settings=settings,
        versions={},
        episodes=games,
        wins=wins,
        ties=ties,
        losses=shares["loss"],
        causes={},
        mean_length=1,
        wall_seconds=1,
        **{f"{name}_rate": wilson(count, games) for name, count in shares.items()},  # type: ignore[arg-type]
        **how,
    )
    return FidelityRow(plan=plan, result=result)


FAITHFUL_ROW = row(400, 200, 1000, TRUE, {})
FAST_ROW = row(410, 200, 1000, {"physics": "fast"}, {"physics": "fast", **FAST})
COARSE = {**FAST, "timestep": 0.005, "substeps": 3}
COARSE_ROW = row(550, 200, 1000, COARSE, {"physics": "custom", **COARSE})


def speeds(path: Path) -> Path:
    lines = [
        {"env": "sumo-ants", "setting": {"physics": "fast"}, "ratio": 3.0, "low": 2.8, "high": 3.2},
        {"env": "sumo-ants", "setting": COARSE, "ratio": 5.0, "low": 4.5, "high": 5.5},
    ]
    path.write_text("".join(f"{json.dumps(line)}\n" for line in lines))
    return path


def test_each_setting_is_compared_with_the_faithful_games(frontier: ModuleType, tmp_path: Path) -> None:
    measured = frontier.read_speeds(speeds(tmp_path / "speeds.jsonl"))
    true, fast, coarse = frontier.points([COARSE_ROW, FAST_ROW], [FAITHFUL_ROW], measured)
    assert true.setting == frontier.profile("sumo-ants", "faithful")
    assert not true.differences
    assert (fast.speed.ratio, coarse.speed.ratio) == (3.0, 5.0)  # the slowest first
    # 41 % against 40 % of 1000 games each: a point, with 4.3 to either side
    assert fast.differences["win"].value == pytest.approx(0.01)
    assert fast.differences["win"].high == pytest.approx(0.053, abs=1e-3)
    assert fast.differences["tie"].value == 0
    assert (fast.verdict, coarse.verdict) == ("within noise", "no")


def test_more_games_narrow_the_verdict_and_a_seed_counts_once(frontier: ModuleType) -> None:
    settings = {"physics": "fast", **FAST}
    base = [row(4000, 2000, 10_000, TRUE, {}, seed) for seed in (0, 1)]
    cheap = [row(4000, 2010, 10_000, {"physics": "fast"}, settings, seed) for seed in (0, 1, 1)]
    _, fast = frontier.points([*base, *cheap], [], {})
    assert fast.counts == frontier.Counts(8000, 4020, 20_000)
    assert (fast.verdict, fast.speed) == ("yes", None)


def test_a_score_keeps_the_physics_it_was_played_in(frontier: ModuleType) -> None:
    """Even if the profile of that name is another one by now."""
    old = row(410, 200, 1000, {"physics": "fast"}, {"physics": "fast", **COARSE})
    _, point = frontier.points([old], [FAITHFUL_ROW], {})
    assert (point.setting.timestep, point.setting.substeps) == (0.005, 3)


def test_other_options_and_lone_settings(frontier: ModuleType) -> None:
    modern = row(410, 200, 1000, {"inertia": "modern"}, {"physics": "fast", **FAST})
    assert frontier.points([modern], [FAITHFUL_ROW], {}) == []
    with pytest.raises(ConfigError, match="no faithful games to compare with"):
        frontier.points([FAST_ROW], [], {})


@pytest.mark.parametrize(
    "line", ["nonsense", "{}", '{"env": "sumo-ants", "setting": {"solver": "no"}, "ratio": 1}']
)
def test_wrong_speeds_are_one_line(frontier: ModuleType, tmp_path: Path, line: str) -> None:
    path = tmp_path / "speeds.jsonl"
    path.write_text(f"{line}\n")
    with pytest.raises(ConfigError) as caught:
        frontier.read_speeds(path)
    assert "\n" not in str(caught.value)


def test_page_and_picture(make_frontier: ModuleType, tmp_path: Path) -> None:
    rows, page, picture = tmp_path / "rows.jsonl", tmp_path / "page.md", tmp_path / "frontier.png"
    kept = [FAITHFUL_ROW, FAST_ROW, COARSE_ROW]
    computed = {"win", "win_or_tie"}
    rows.write_text("".join(f"{each.model_dump_json(exclude=computed)}\n" for each in kept))
    page.write_text(f"before\n{make_frontier.BEGIN}\nold\n{make_frontier.END}\nafter\n")
    files = ("--rows", rows, "--speeds", speeds(tmp_path / "s.jsonl"), "--page", page, "--picture", picture)
    make_frontier.main([str(each) for each in files])
    text = page.read_text()
    assert text.startswith("before\n")
    assert text.endswith("\nafter\n")
    assert "old" not in text
    assert "### Settings of sumo-ants" in text
    assert "| faithful: PGS, RK4, 5 × 0.003 s | 1 | v2 against v1, sampled/sampled | 1000 |" in text
    assert "| Newton, leapfrog, 3 × 0.005 s | 5.00 [4.50, 5.50] |" in text
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_the_page_has_a_place_for_the_tables(make_frontier: ModuleType) -> None:
    text = (ROOT / "docs" / "fidelity.md").read_text("utf-8")
    assert text.index(make_frontier.BEGIN) < text.index(make_frontier.END)
