"""The students in the package: sizes, provenance, and when ``auto`` means one of them."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from apil_core import UnknownNameError, VictimError, View, load_policy, make_game
from apil_core.api.config import RunConfig
from apil_core.config.resolve import complete
from apil_core.plugins.default_victim import default_victim, is_here
from apil_core.plugins.discovery import discover
from apil_core.policies import zoo_catalogue as catalogue
from apil_core.policies.loading import victim_name
from apil_core.policies.zoo_cache import cached_file
from apil_core.training.export import embedded

ROOT = Path(__file__).parents[2]
STUDENTS = (
    "kick-and-defend/kicker/v1",
    "kick-and-defend/defender/v1",
    "you-shall-not-pass/blocker/v1",
    "you-shall-not-pass/runner/v1",
    "sumo-humans/fighter/v3",
    "sumo-ants/fighter/v1",
)


@pytest.fixture(autouse=True)
def empty_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("APIL_CACHE", str(tmp_path))


@pytest.mark.parametrize("name", STUDENTS)
def test_every_role_of_the_papers_games_has_a_student_of_at_most_a_megabyte(name: str) -> None:
    path = embedded.known()[name]
    assert path.stat().st_size <= 1_000_000
    policy = load_policy(f"embedded:{name}")
    teacher = catalogue.entries()[name]
    facts, told = teacher.facts, policy.info.provenance
    assert (policy.info.observation_size, policy.info.action_size) == (
        facts.observation_size,
        facts.action_size,
    )
    assert (told["teacher"], told["teacher_sha256"]) == (teacher.full_name, teacher.sha256)
    assert {"code", "steps", "student_score", "teacher_score", "action_error"} <= told.keys()
    own = torch.randn(3, facts.observation_size, generator=torch.Generator().manual_seed(0))
    decision = policy.act(View(own, own, torch.ones(3, dtype=torch.bool)), sample=False)
    assert decision.action.shape == (3, facts.action_size)
    assert decision.action.isfinite().all()
    assert decision.action.std() > 0.01, "it reacts to what it sees"


def test_all_are_listed_as_being_here() -> None:
    rows = {row.name: row for row in embedded.list_embedded()}
    assert set(rows) >= {f"embedded:{name}" for name in STUDENTS}
    for row in rows.values():
        assert row.available
        assert len(row.sha256) == 64
        assert row.provenance.startswith("student of zoo:") or "/adversary/" in row.name


@pytest.mark.parametrize(
    "game", sorted(name.split("/")[0] for name in embedded.known() if "/adversary/" in name)
)
def test_an_adversary_acts_as_its_run_and_says_where_it_is_from(game: str) -> None:
    """The run is at home as ONNX, which the embedded file must equal; both carry the checkpoint's hash."""
    name = f"{game}/adversary/v1"
    assert embedded.known()[name].stat().st_size <= 300_000
    layout = make_game(game, num_envs=1).layout
    attacked = discover().game(game).victim_side
    victim, seat = layout.sides[attacked], layout.sides[1 - attacked]
    policy = load_policy(f"embedded:{name}", seat=seat)
    told = policy.info.provenance
    row = next(row for row in embedded.list_embedded() if row.name == f"embedded:{name}")
    assert row.sha256 == policy.info.sha256
    assert (
        row.provenance == f"{told['method']} against {told['victim']}, {told['steps']} steps; {told['score']}"
    )
    assert {"checkpoint_sha256", "seed", "physics", "licence"} <= told.keys()
    pytest.importorskip("onnxruntime")
    home = ROOT / "docs" / "results" / "campaign" / "cells" / game / told["method"] / f"s{told['seed']}"
    run = load_policy(f"onnx:{home / 'adversary.onnx'}", seat=seat)
    if run.info.provenance["checkpoint_sha256"] != told["checkpoint_sha256"]:
        pytest.skip(f"{home} is of a longer run by now: ship that if it wins more")
    random = torch.Generator().manual_seed(0)
    own, theirs = (torch.randn(4, side.observation_size, generator=random) for side in (seat, victim))
    actions = [
        each.act(View(own, theirs, torch.ones(4, dtype=torch.bool)), sample=False).action
        for each in (policy, run)
    ]
    torch.testing.assert_close(*actions, rtol=0, atol=1e-5)


def test_a_damaged_one_stops_no_list_and_is_named_when_loaded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(embedded, "folder", lambda: tmp_path)
    (tmp_path / "game" / "role").mkdir(parents=True)
    (tmp_path / "game" / "role" / "v1.safetensors").write_bytes(b"torn")
    (row,) = embedded.list_embedded()
    assert (row.name, row.available, row.sha256) == ("embedded:game/role/v1", True, "")
    with pytest.raises(VictimError, match="embedded:game/role/v1: expected a safetensors file"):
        load_policy(row.name)


def test_a_wrong_name_is_told_the_right_ones() -> None:
    with pytest.raises(UnknownNameError, match=r"did you mean 'embedded:kick-and-defend/kicker/v1'"):
        load_policy("embedded:kick-and-defend/kicker/v2")


@pytest.mark.parametrize("env", ["kick-and-defend", "you-shall-not-pass", "sumo-humans", "sumo-ants"])
def test_auto_is_the_zoo_agent_where_it_is_imported_and_else_the_embedded_one(env: str) -> None:
    plugins = discover()
    spec = plugins.game(env)
    assert spec.fallback_victim == spec.default_victim.replace("zoo:", "embedded:")
    assert default_victim(spec, plugins) == spec.fallback_victim
    assert victim_name(RunConfig(env=env), plugins) == spec.fallback_victim
    assert complete(RunConfig(env=env, method="adrl"), plugins).victim == spec.fallback_victim
    file = cached_file(catalogue.entries()[spec.default_victim.removeprefix("zoo:")])
    file.parent.mkdir(parents=True)
    file.write_bytes(b"damaged: an error where it is loaded, never a reason to attack somebody else")
    assert default_victim(spec, plugins) == spec.default_victim
    assert complete(RunConfig(env=env, method="adrl"), plugins).victim == spec.default_victim


def test_a_game_without_fallback_keeps_its_own_victim() -> None:
    plugins = discover()
    for env in ("run-to-goal-humans", "toy-pursuit"):
        spec = plugins.game(env)
        assert default_victim(spec, plugins) == spec.default_victim


def test_where_no_list_tells_a_policy_counts_as_here() -> None:
    plugins = discover()
    assert is_here("baseline:zero/3x1", plugins)
    assert is_here("nobody:knows", plugins)
    assert not is_here("zoo:kick-and-defend/kicker/v1", plugins)
