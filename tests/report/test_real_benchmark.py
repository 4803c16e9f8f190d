"""A small benchmark that really ran: trained, scored, crossed, and reported by the command."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from apil_core.cli.bench_report import report
from apil_core.common.errors import ConfigError
from apil_core.evaluation.results import PolicyId
from apil_core.studies.bench.cells import resolve_matrix
from apil_core.studies.bench.folder import BenchDir, read_score, write_score
from apil_core.studies.bench.jobs import make_jobs
from apil_core.studies.bench.matrix import Matrix
from apil_core.studies.bench.work import perform
from apil_core.studies.report.page import render
from apil_core.studies.report.report_data import gather

TOY = "toy-pursuit"
EPISODES = 40


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> BenchDir:
    matrix = Matrix.model_validate(
        {
            "methods": ["adrl", "e_apil"],
            "games": [TOY],
            "steps": 2048,
            "config": {
                "num_envs": 32,
                "threads": 1,
                "ppo": {"num_steps": 16, "epochs": 1, "minibatches": 1},
                "recorders": ["jsonl"],
            },
            "scores": {"plain": {"episodes": EPISODES}, "blinded": {"episodes": EPISODES, "blind": "zeros"}},
            "crossplay": {"episodes": EPISODES},
        }
    )
    made = BenchDir(tmp_path_factory.mktemp("real") / "bench")
    benchmark = resolve_matrix(matrix)
    made.write_matrix(benchmark.matrix)
    for job in make_jobs(benchmark):
        assert perform(made.path, job.name) == "done"
    return made


def test_its_numbers_are_those_of_its_scores(bench: BenchDir) -> None:
    data = gather([bench.path])
    assert [(table.number, table.blind) for table in data.tables] == [(1, None), (2, "zeros")]
    for table, name in zip(data.tables, ("plain", "blinded"), strict=True):
        for own in table.rows[0]:
            score = read_score(bench.cell(f"{TOY}/{own.column}/s0").path, name)
            if own.column == "baseline":
                assert own.scores == []  # the toy game has none
                continue
            assert own.win.measured is not None
            assert own.win_or_tie.measured is not None
            assert own.win.measured.value == score.win_rate.value
            assert (own.win.measured.low, own.win.measured.high) == (score.win_rate.low, score.win_rate.high)
            assert own.win_or_tie.measured.value == score.win_or_tie_rate.value
            assert own.scores[0].causes == dict(sorted(score.causes.items(), key=lambda item: -item[1]))
    assert data.unfinished == []
    assert len(data.provenance.runs) == 2
    assert {score.episodes for score in data.crossplay[0].played} == {EPISODES}
    assert {"kl", "bound"} <= data.diagnostics[0].lines.keys()


def test_a_game_that_the_paper_never_played_has_no_claim_and_no_budget_of_it(bench: BenchDir) -> None:
    data = gather([bench.path])
    assert data.claims == []
    (setting,) = data.settings
    assert (setting.published_steps, setting.budget, setting.matches_published) == (None, "", False)
    kinds = {warning.kind for warning in data.warnings if warning.loud}
    assert not kinds & {"budget", "action modes"}
    words = [mark for row in data.tables[0].rows for cell in row for mark in cell.marks]
    assert set(words) == {"1 seed", f"{EPISODES} games"}
    assert "published budget" not in render(data)


def test_a_baseline_of_other_games_is_not_taken(bench: BenchDir) -> None:
    """The toy game has no baseline: one that would be is put there, of the same games and of others."""
    score = read_score(bench.cell(f"{TOY}/adrl/s0").path, "plain")
    who = {"adversary": PolicyId(name="somebody", sha256=""), "trained_steps": None}
    same = score.model_copy(update=who)
    other = same.model_copy(update={"game_options": {**score.game_options, "max_steps": 3}})
    found = []
    try:
        for each in (same, other):
            write_score(bench.adversary_dir(TOY), "plain", each)
            table = gather([bench.path]).tables[0]
            found.append([cell.seeds for cell in table.rows[0] if cell.column == "baseline"])
    finally:
        shutil.rmtree(bench.adversary_dir(TOY))
    assert found == [[1], [0]]


def test_the_command_writes_tables_and_says_what_it_found(
    bench: BenchDir, capsys: pytest.CaptureFixture[str]
) -> None:
    assert report([bench.path], tables_only=True) == 0
    out = capsys.readouterr().out
    assert "least: 1" in out  # seeds
    assert "page" not in out
    names = {path.name for path in (bench.report / "tables").iterdir()}
    assert {"t1-s1.csv", "t1-s1.tex", "differences.csv", "runs.csv"} <= names
    assert {name.rpartition(".")[2] for name in names} == {"csv", "tex"}
    assert not (bench.report / "index.html").exists()


def test_the_same_directory_twice_counts_once_and_the_answer_can_be_json(
    bench: BenchDir, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    again = bench.path / ".." / "bench"
    assert report([bench.path, again], out=tmp_path, tables_only=True, json=True) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["page"], found["unfinished"]) == (None, [])
    assert len(found["tables"]) == len(list((tmp_path / "tables").iterdir()))
    assert not any(warning["kind"] == "copies" for warning in found["warnings"])
    with pytest.raises(ConfigError, match="tables exists already; choose another name, or --force"):
        report([bench.path], out=tmp_path, tables_only=True)
    assert report([bench.path], out=tmp_path, tables_only=True, force=True) == 0


def test_a_cell_named_as_a_run_of_its_own_counts_once(bench: BenchDir) -> None:
    found = gather([bench.path], [bench.cell(f"{TOY}/adrl/s0").path])
    assert len(found.provenance.runs) == 2
    assert found.provenance.directories == [str(bench.path)]
    assert not any(warning.kind == "copies" for warning in found.warnings)


def test_single_runs_beside_a_benchmark_are_named(bench: BenchDir, tmp_path: Path) -> None:
    run = shutil.copytree(bench.cell(f"{TOY}/adrl/s0").path, tmp_path / "run")
    (run / "environment.json").write_text('[{"versions": 3}]')
    assert gather([bench.path], [run]).provenance.directories == [str(bench.path), str(run)]


def test_a_damaged_cell_is_listed_and_hides_no_other(bench: BenchDir) -> None:
    path = bench.cell(f"{TOY}/adrl/s0").path / "scores" / "plain.json"
    text = path.read_text()
    try:
        path.write_text("{")
        found = gather([bench.path])
    finally:
        path.write_text(text)
    assert [(each.method, each.status) for each in found.unfinished] == [("adrl", "damaged")]
    assert "plain.json" in found.unfinished[0].reason
    assert [cell.seeds for cell in found.tables[0].rows[0] if cell.column == "e_apil"] == [1]


def test_a_damaged_crossplay_is_a_warning_that_names_it(bench: BenchDir) -> None:
    path = bench.crossplay_path(TOY)
    text = path.read_text()
    try:
        path.write_text(json.dumps({"env": TOY}))
        found = gather([bench.path])
    finally:
        path.write_text(text)
    assert found.crossplay == []
    assert any(w.loud and str(path) in w.text for w in found.warnings if w.kind == "damaged")
