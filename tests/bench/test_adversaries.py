"""Adversaries that were trained elsewhere: scored by a matrix like its own, and reported beside them."""

from __future__ import annotations

import csv
import json
import shutil
from pathlib import Path
from typing import Any

import pytest
import torch

from apil_core import ConfigError, NetworkShape, evaluate, save_policy
from apil_core.cli import main
from apil_core.evaluation.results import EvaluationResult
from apil_core.studies.bench.cells import resolve_matrix
from apil_core.studies.bench.folder import BenchDir, read_score
from apil_core.studies.bench.jobs import JobStatus, make_jobs
from apil_core.studies.bench.matrix import load_matrix
from apil_core.studies.bench.players import check_same_adversaries, with_full_names
from apil_core.studies.bench.work import perform
from apil_core.studies.report.report_data import gather
from apil_core.studies.report.table_models import Cell
from apil_core.studies.report.tables import write_tables
from bench.small_matrix import small_matrix

TOY, SHAPE = "toy-pursuit", NetworkShape("mlp", 7, 2, width=0, hidden=(), clip=10.0)
SCORES = {"plain": {"episodes": 20}, "blinded": {"episodes": 20, "blind": "zeros"}}
NOTE = "published weights, replayed here"


def chaser(path: Path, gain: float = 5.0) -> Path:
    """A pursuer that runs at the evader: columns 2 and 3 are its place minus one's own."""
    weight = torch.zeros(2, 7)
    weight[0, 2] = weight[1, 3] = gain
    weights = {"mlp.0.weight": weight, "mlp.0.bias": torch.zeros(2), "log_std": torch.full((2,), -3.0)}
    standard = {"observation.mean": torch.zeros(7), "observation.std": torch.ones(7)}
    save_policy(path, SHAPE, weights | standard, {"source": "this test"})
    return path


def benchmark(root: Path, **changes: Any) -> BenchDir:
    """A finished benchmark."""
    resolved = with_full_names(resolve_matrix(small_matrix(scores=SCORES, **changes)), "m")
    bench = BenchDir(root)
    bench.write_matrix(resolved.matrix)
    for job in make_jobs(resolved):
        assert perform(root, job.name) == "done"
    return bench


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> BenchDir:
    """With a published adversary and one without weights."""
    folder = tmp_path_factory.mktemp("adversaries")
    named = {"chaser": f"safetensors:{chaser(folder / 'chaser.safetensors')}", "still": "zero"}
    return benchmark(folder / "b", adversaries={TOY: named})


def cell(found: list[Cell], column: str) -> Cell:
    return next(each for each in found if each.column == column)


def test_a_score_is_what_evaluation_gives(bench: BenchDir) -> None:
    config = bench.cell(f"{TOY}/adrl/s0").config()
    for name, blind in (("plain", None), ("blinded", "zeros")):
        kept = bench.adversary(TOY, name, label="chaser")
        again = evaluate(kept.adversary.name, like=config, episodes=20, blind=blind)
        assert (kept.wins, kept.ties, kept.causes) == (again.wins, again.ties, again.causes)
        assert kept.trained_steps is None
    assert not (bench.path / "cells" / TOY / "chaser").exists()


def test_it_stands_beside_the_methods_in_every_form(bench: BenchDir, tmp_path: Path) -> None:
    data = gather([bench.path])
    first, second = data.tables
    assert first.columns == second.columns == ["baseline", "adrl", "chaser", "still"]
    own = cell(first.rows[0], "chaser")
    assert (own.replayed, own.marks) == (NOTE, [NOTE, "20 games"])
    kept = bench.adversary(TOY, "plain", label="chaser")
    assert own.win.measured is not None
    assert own.win.measured.value == kept.win_rate.value
    assert (own.scores[0].steps, own.scores[0].seed) == (None, None)
    assert cell(first.rows[0], "still").replayed == "no weights, replayed here"
    assert {(each.column, each.base) for each in data.differences} >= {
        ("chaser", "adrl"),
        ("still", "chaser"),
    }
    write_tables(data, tmp_path)
    rows = list(csv.DictReader((tmp_path / "t1-s1.csv").open()))
    row = next(each for each in rows if (each["column"], each["share"]) == ("chaser", "win"))
    assert row["marks"] == f"{NOTE}; 20 games"
    assert row["sources"] == f"{kept.adversary.name}, SHA-256 {kept.adversary.sha256[:12]}"
    assert f"chaser: {NOTE}." in (tmp_path / "t1-s1.tex").read_text()


def test_only_what_is_missing_is_played(bench: BenchDir, tmp_path: Path) -> None:
    shutil.copytree(bench.path, tmp_path / "b")
    matrix = bench.matrix()
    more = {TOY: {**matrix.adversaries[TOY], "drunk": "baseline:random/7x2"}}
    again = resolve_matrix(matrix.model_copy(update={"adversaries": more}))
    status = JobStatus(BenchDir(tmp_path / "b"), again)
    left = [job.name for job in make_jobs(again) if not status.is_done(job)]
    assert left == [f"adversaries/{TOY} drunk {matrix.victims[TOY][0]}"]


def test_other_weights_under_the_same_name_are_refused(bench: BenchDir) -> None:
    file = bench.path.parent / "chaser.safetensors"
    weights = file.read_bytes()
    check_same_adversaries(bench, with_full_names(resolve_matrix(bench.matrix()), "m"))
    chaser(file, gain=1.0)
    with pytest.raises(
        ConfigError, match=r"adversaries\.toy-pursuit\.chaser: .* changed since it was scored"
    ):
        check_same_adversaries(bench, with_full_names(resolve_matrix(bench.matrix()), "m"))
    file.write_bytes(weights)


def test_a_run_plays_the_games_of_the_cells(bench: BenchDir, tmp_path: Path) -> None:
    run = f"run:{bench.cell(f'{TOY}/adrl/s0').path}"
    game = {
        "num_envs": 32,
        "ppo": {"num_steps": 16},
        "game": {"max_steps": 30},
        "evaluation": {"episodes": 0},
    }
    found = benchmark(tmp_path / "b", config=game, adversaries={TOY: {"earlier": run}})
    own = cell(gather([found.path]).tables[0].rows[0], "earlier")
    assert own.replayed == "a run, replayed here"
    assert found.adversary(TOY, "plain", label="earlier").options_played["max_steps"] == 30


def test_a_path_begins_at_the_matrix_file(tmp_path: Path) -> None:
    chaser(tmp_path / "chaser.safetensors")
    named = "{a: 'safetensors:chaser.safetensors', b: zero}"
    text = f"methods: [adrl]\ngames: [{TOY}]\nadversaries:\n  {TOY}: {named}\n"
    (tmp_path / "m.yaml").write_text(text)
    found = load_matrix(str(tmp_path / "m.yaml"))
    assert found.adversaries == {TOY: {"a": f"safetensors:{tmp_path / 'chaser.safetensors'}", "b": "zero"}}


@pytest.mark.parametrize(
    ("named", "message"),
    [
        (
            {TOY: {"adrl": "zero"}},
            "adversaries.toy-pursuit.adrl: that is a method's or the game's own; rename",
        ),
        ({TOY: {"baseline": "zero"}}, "adversaries.toy-pursuit.baseline: that is a method's"),
        ({TOY: {"a b": "zero"}}, "adversaries.toy-pursuit.a b: a name is made of letters"),
        ({"sumo-ants": {"a": "zero"}}, "adversaries: 'sumo-ants' is not among the matrix's games"),
    ],
)
def test_a_wrong_label_is_named(named: dict[str, dict[str, str]], message: str) -> None:
    with pytest.raises(ValueError, match=message.replace(".", r"\.")):
        small_matrix(adversaries=named)


def test_a_policy_that_does_not_load_or_fit_stops_the_benchmark_before_it_starts() -> None:
    for name, reason in (
        ("none:x", "unknown policy 'none:x'"),
        ("baseline:zero/6x2", "takes 6 observations"),
    ):
        resolved = resolve_matrix(small_matrix(adversaries={TOY: {"bad": name}}))
        with pytest.raises(ConfigError, match=rf"^m, adversaries\.toy-pursuit\.bad: .*{reason}"):
            with_full_names(resolved, "m")


def kept(bench: BenchDir, path: Path, **changes: Any) -> Path:
    """A score of the chaser, as ``apil eval --keep`` writes it, without the benchmark."""
    score = bench.adversary(TOY, "plain", label="chaser").model_copy(update=changes)
    path.write_text(score.model_dump_json())
    return path


def test_stored_scores_are_further_columns(bench: BenchDir, tmp_path: Path) -> None:
    run = bench.cell(f"{TOY}/adrl/s0").path
    cross = tmp_path / "cross.json"
    flags = ["--env", TOY, "--episodes", "10", "--quiet", "--out", str(cross)]
    players = ["--adversaries", f"{run},zero", "--labels", "adrl,frozen", "--victims", "auto"]
    with pytest.raises(SystemExit) as done:
        main(["crossplay", *players, *flags])
    assert done.value.code in (0, None)
    data = gather([run, kept(bench, tmp_path / "bansal.json"), cross])
    (row,) = data.tables[0].rows
    found = {each.column: (each.replayed, each.episodes) for each in row if each.scores}
    assert found == {
        "adrl": ("", 20),
        "bansal": ("published weights, score from bansal.json", 20),
        "frozen": ("no weights, score from cross.json", 10),
    }
    assert str(tmp_path / "bansal.json") in cell(row, "bansal").scores[0].source
    assert [len(each.adversaries) for each in data.crossplay] == [2]


def test_without_a_run_in_the_same_games_a_stored_score_has_a_table_of_its_own(
    bench: BenchDir, tmp_path: Path
) -> None:
    run = bench.cell(f"{TOY}/adrl/s0").path
    other = kept(bench, tmp_path / "mode.json", victim_actions="mode")
    data = gather([run, other])
    assert [[each.column for each in t.rows[0] if each.scores] for t in data.tables] == [
        ["adrl"],
        ["mode"],
        ["adrl"],
    ]
    assert "not trained here" in data.setting(data.tables[1].setting).label
    (alone,) = gather([kept(bench, tmp_path / "adrl.json")]).tables
    (own,) = (each for each in alone.rows[0] if each.scores)
    assert own.column == "adrl (adrl)"  # not taken for the method


def test_a_file_of_something_else_is_one_line(bench: BenchDir, tmp_path: Path) -> None:
    blinded = kept(bench, tmp_path / "v.json", blind_victim="zeros")
    with pytest.raises(ConfigError, match=r"v\.json: its victim was blinded"):
        gather([blinded])
    (tmp_path / "x.json").write_text(json.dumps({"wins": 3}))
    with pytest.raises(ConfigError, match=r"x\.json is neither a score of apil eval nor a cross-play"):
        gather([tmp_path / "x.json"])


def test_eval_keeps_the_score_of_any_policy_in_a_file(tmp_path: Path) -> None:
    file = tmp_path / "still.json"
    with pytest.raises(SystemExit) as done:
        main(["eval", "zero", "--env", TOY, "--episodes", "10", "--quiet", "--keep", str(file)])
    assert done.value.code in (0, None)
    assert EvaluationResult.model_validate_json(file.read_text()).episodes == 10
    (row,) = gather([file]).tables[0].rows
    assert cell(row, "still").episodes == 10
    assert read_score(tmp_path, "none") is None
