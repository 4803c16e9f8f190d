"""A benchmark's directory gathered: what goes into which table, and what is said about it."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from pathlib import Path

import pytest

from apil_core.common.errors import RunDirError
from apil_core.studies.bench.folder import BenchDir
from apil_core.studies.report.latex import latex_table
from apil_core.studies.report.models import ReportData
from apil_core.studies.report.report_data import gather
from apil_core.studies.report.table_models import Cell, Table
from apil_core.studies.report.tables import write_tables
from report.sample import BASELINES, FAILED, KICK, SUMO, WORKING, sample_bench

PREDICTION = "options.apil.prediction"


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> BenchDir:
    return sample_bench(tmp_path_factory.mktemp("bench"))


@pytest.fixture(scope="module")
def data(bench: BenchDir) -> ReportData:
    return gather([bench.path])


def _table(data: ReportData, number: int, **axes: str) -> Table:
    return next(
        table for table in data.tables if table.number == number and data.setting(table.setting).axes == axes
    )


def _cell(table: Table, game: str, column: str) -> Cell:
    return next(each for row in table.rows for each in row if (each.game, each.column) == (game, column))


def test_table_1_is_the_mean_over_seeds_beside_the_published_value(data: ReportData) -> None:
    """ADRL won 480 and 500 of 1000 games and tied 10 each; published are 48 and 49 %."""
    own = _cell(_table(data, 1), KICK, "adrl")
    assert own.win.measured is not None
    assert own.win_or_tie.measured is not None
    assert (own.win.measured.value, own.win_or_tie.measured.value) == (0.49, 0.5)
    assert own.win.measured.per_seed == [0.48, 0.5]
    assert [score.seed for score in own.scores] == [0, 1]
    assert (own.win.published, own.win_or_tie.published) == (0.48, 0.49)
    assert (own.win.verdict, own.episodes) == ("within noise", 2000)
    assert own.marks == ["1 M of 35 M = 2.9 %", "2 seeds", "fast physics"]


def test_a_method_without_cells_still_shows_what_was_published(data: ReportData) -> None:
    own = _cell(_table(data, 1), KICK, "apil")
    assert (own.win.measured, own.win.published, own.win.verdict) == (None, 0.85, "not measured")


def test_the_baseline_is_an_agent_not_a_training(data: ReportData) -> None:
    own = _cell(_table(data, 1), KICK, "baseline")
    assert (own.scores[0].source, own.scores[0].steps) == (BASELINES[KICK], None)
    assert own.marks == ["fast physics"]


def test_blinded_scores_make_table_2(data: ReportData) -> None:
    table = _table(data, 2)
    own = _cell(table, KICK, "adrl")
    assert own.win.measured is not None
    assert (table.blind, own.win.measured.per_seed) == ("zeros", [0.24, 0.25])


def test_an_axis_never_mixes_into_the_usual_cells(data: ReportData) -> None:
    """With ã 700 and 720 wins, without it a tenth of 700 less."""
    usual = _cell(_table(data, 1), KICK, "e_apil").win.measured
    other = _cell(_table(data, 1, **{PREDICTION: "none"}), KICK, "e_apil").win
    assert usual is not None
    assert other.measured is not None
    assert (usual.per_seed, other.measured.per_seed) == ([0.7, 0.72], [0.63, 0.65])
    assert (other.published, other.verdict) == (None, "no published value")


def test_the_ablation_puts_the_default_first(data: ReportData) -> None:
    own = next(each for each in data.ablations if each.game == KICK)
    assert (own.axis, [row.value for row in own.rows]) == (PREDICTION, ["imitator", "none"])
    difference = own.rows[1].difference
    assert difference is not None
    assert (difference.win.value, difference.win_verdict) == (pytest.approx(-0.07), "lower")
    assert (own.rows[0].imitator_error, own.rows[1].imitator_error) == (pytest.approx(1.2), None)


def test_tables_3_and_4_are_the_victims_view(data: ReportData) -> None:
    """The baseline adversary wins 280 of 1000 against the original: the victim wins 720."""
    third, fourth = _table(data, 3), _table(data, 4)
    wins = [
        _cell(table, KICK, column).win.measured
        for table in (third, fourth)
        for column in ("baseline", "adrl", "e_apil")
    ]
    assert [share and share.value for share in wins] == [0.72, 0.7, 0.75, 0.3, 0.31, 0.6]
    assert _cell(fourth, KICK, "baseline").win.published == 0.1
    setting = data.setting(fourth.setting)
    assert (setting.steps, setting.retrain_steps) == (1_000_000, 500_000)
    assert setting.budget == "500 k of 10 M = 5 %"


def test_methods_are_compared_within_a_table(data: ReportData) -> None:
    """E-APIL's 71 % of 2000 games minus ADRL's 49 %."""
    table = _table(data, 1)
    found = next(
        each
        for each in data.differences
        if (each.table, each.game, each.column, each.base) == (table.id, KICK, "e_apil", "adrl")
    )
    assert found.win.value == pytest.approx(0.22)
    assert found.win_verdict == "higher"


def test_what_is_missing_is_listed_with_its_reason(data: ReportData) -> None:
    found = {each.path.partition("cells/")[2]: each for each in data.unfinished}
    assert found.keys() == {FAILED, WORKING}
    assert (found[FAILED].status, found[FAILED].reason) == ("failed", "the disk is full")
    assert (found[WORKING].steps, found[WORKING].planned_steps) == (400_000, 1_000_000)
    assert _cell(_table(data, 1), SUMO, "adrl").seeds == 1


def test_warnings_are_computed(data: ReportData) -> None:
    kinds = {warning.kind for warning in data.warnings if warning.loud}
    assert kinds == {"budget", "physics", "action modes", "seeds", "settings", "unfinished"}
    texts = [warning.text for warning in data.warnings]
    assert any(
        "adrl in sumo-humans: 98 % of win+tie are ties (10 wins and 490 ties" in text for text in texts
    )
    assert any("a tie here means: fighter_1 left ring untouched" in text for text in texts)
    assert any("e_apil in kick-and-defend: in 2 of 2 runs the imitator predicts" in text for text in texts)


def test_an_aggregate_over_two_seeds_says_what_it_cannot(data: ReportData) -> None:
    """E-APIL's win+tie: 72 and 74, 50 and 52 %; the middle two are 52 and 72, their mean 62."""
    setting = _table(data, 1).setting
    found = {(e.column, e.metric): e for e in data.aggregates if e.setting == setting}
    own = found["e_apil", "win_or_tie"]
    assert own.iqm == pytest.approx(0.62)
    assert own.low is not None
    assert (own.games, own.seeds, "lower bound" in own.note) == ([KICK, SUMO], 2, True)
    assert found["baseline", "win"].note == "Not trained here: one agent per game."


def test_curves_are_the_means_of_seeds(data: ReportData) -> None:
    """Windows of seeds 0 and 1 end at 480 and 500 wins of 1000."""
    panel = next(panel for panel in data.curves if panel.game == KICK)
    group = next(group for group in panel.groups if group.label.startswith("adrl"))
    assert (group.seeds, group.lines["win"].value[-1]) == ([0, 1], pytest.approx(0.49))
    assert (panel.baseline_win, panel.baseline_win_or_tie) == (0.28, 0.29)


def test_retrainings_crossplays_activations_and_pictures_come_along(data: ReportData) -> None:
    own = data.retraining[0]
    assert [group.label for group in own.groups] == ["e_apil", "baseline"]
    assert own.groups[0].lines["win"].value == [0.2, 0.3, 0.4, 0.5, 0.6]
    assert (own.steps, own.planned_steps, own.status) == (500_000, 500_000, "finished")
    score = data.crossplay[0].score("e_apil", "original")
    assert score is not None
    assert score.win_rate.value == 0.7
    assert [each.mean for each in data.activations[0].log_likelihood] == [-10.0, -20.0, -30.0]
    assert data.snapshots[0].data_uri.startswith("data:image/png;base64,iVBOR")


def test_diagnostics_have_the_lemmas_numbers(data: ReportData) -> None:
    """1 game-step in 1000 of 100 000, 500 games: 0.2 steps per game in which rewards are not opposite."""
    own = next(each for each in data.diagnostics if (each.game, each.method) == (KICK, "e_apil"))
    assert own.facts["steps with r^α + r^ν ≠ 0, per game"] == pytest.approx(0.2)
    assert own.facts["imitator's squared error over the best constant's"] == pytest.approx(1.2)
    assert {"kl", "bound"} <= own.lines.keys()


def test_evidence_survives_json(data: ReportData) -> None:
    assert ReportData.model_validate_json(data.model_dump_json()) == data


def _rows(paths: list[Path], name: str) -> Iterator[dict[str, str]]:
    yield from csv.DictReader(next(path for path in paths if path.name == name).open())


def test_names_in_latex_are_text(data: ReportData) -> None:
    table, nasty = _table(data, 1), "_ % & # $ { } \\ ~ ^ [x]\x1b"
    said = (
        r"\_ \% \& \# \$ \{ \} \textbackslash{} \textasciitilde{} \textasciicircum{} {[}x{]}"
        r"\textbackslash{}u001b"
    )
    cells = [[cell.model_copy(update={"game": nasty}) for cell in row] for row in table.rows]
    changed = {"columns": [nasty, *table.columns[1:]], "side": nasty, "title": nasty, "rows": cells}
    latex = latex_table(data, table.model_copy(update=changed))
    assert latex.count(said) == 3 + len(table.rows)
    assert nasty not in latex


def test_tables_are_written_as_csv_and_latex(data: ReportData, tmp_path: Path) -> None:
    paths = write_tables(data, tmp_path / "tables")
    first = _table(data, 1)
    row = next(
        row
        for row in _rows(paths, f"{first.id}.csv")
        if (row["game"], row["column"], row["share"]) == (KICK, "adrl", "win")
    )
    expected = {
        "measured": "0.49",
        "published": "0.48",
        "seeds": "2",
        "episodes": "2000",
        "per_seed": "0.48 0.5",
    }
    assert {name: row[name] for name in expected} == expected
    assert (row["steps"], row["verdict"]) == ("1000000", "within noise")
    latex = (tmp_path / "tables" / f"{first.id}.tex").read_text()
    assert r"1 M of 35 M = 2.9 \% of the published budget" in latex
    assert latex.count("{") == latex.count("}")
    assert r"e\_apil" in latex
    assert r"49.0 {\scriptsize [46.8, 51.2]} (48)$\approx$" in latex
    assert not list((tmp_path / "tables").glob("*.md"))
    (missing,) = (row for row in _rows(paths, "unfinished.csv") if row["status"] == "failed")
    assert missing["reason"] == "the disk is full"
    crossed = next(row for row in _rows(paths, "crossplay.csv") if row["adversary"] == "e_apil")
    assert (crossed["victim"], crossed["win_value"]) == ("original", "0.7")


def test_a_directory_that_is_nothing_is_named(tmp_path: Path) -> None:
    with pytest.raises(RunDirError, match=r"is no benchmark .* and no run"):
        gather([tmp_path])
