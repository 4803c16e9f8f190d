"""What is never mixed into one number."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import create_model
from studies.paper_runs import VICTIM, row

from apil_core import Method, MethodSpec, RunConfig, define
from apil_core.config.resolve import complete
from apil_core.plugins.registry import default_plugins
from apil_core.studies.bench.folder import write_score
from apil_core.studies.report.models import ReportData
from apil_core.studies.report.report_data import gather
from apil_core.studies.report.settings import default_config
from apil_core.testing import tiny_config
from apil_core.training.storage.run_dir import RunDir
from report.sample import KICK, VICTIMS, result, write_run

TOY = "toy-pursuit"
ROWS = [row(1000, 100, 50), row(2000, 100, 60)]

EDITED = """
from pydantic import BaseModel
from apil_core import Method, MethodSpec, hookimpl
class Options(BaseModel):
    gain: float = {gain}
class Edited(Method):
    pass
@hookimpl
def register_methods():
    return [MethodSpec("edited", "edited_for_a_report:Edited", config="edited_for_a_report:Options")]
"""


def _run(path: Path, wins: int, score: dict[str, Any] | None = None, **changes: Any) -> RunDir:
    run = RunDir(path)
    config = tiny_config(**{"method": "adrl", "victim": VICTIM, "steps": 2000, **changes})
    write_run(run, complete(config, default_plugins()), ROWS)
    run.write_json(run.result_path, {"status": "finished", "steps": 2000})
    own = {"env": TOY, "trained_steps": 2000, "game_settings": {}, **(score or {})}
    write_score(run.path, "plain", result(own.pop("env"), wins, 0, 100, **own))
    return run


def _numbers(data: ReportData) -> list[list[float]]:
    """Shares per seed of every cell of table 1."""
    return [
        cell.win.measured.per_seed
        for table in data.tables
        for row in table.rows
        for cell in row
        if cell.win.measured is not None
    ]


def _gather(*runs: RunDir) -> ReportData:
    return gather([run.path for run in runs])


def test_seeds_of_one_attack_are_one_number(tmp_path: Path) -> None:
    runs = [_run(tmp_path / str(seed), 10 * (seed + 1), seed=seed) for seed in (2, 0, 1)]
    assert _numbers(_gather(*runs)) == [[0.1, 0.2, 0.3]]


def test_budgets_are_two_numbers(tmp_path: Path) -> None:
    short = _run(tmp_path / "a", 10, {"trained_steps": 1024}, seed=1, steps=1024)
    found = _gather(_run(tmp_path / "b", 20), short)
    assert _numbers(found) == [[0.2], [0.1]]
    assert [setting.label for setting in found.settings] == ["2 k steps", "1.02 k steps"]


def test_action_modes_and_victims_are_two_numbers(tmp_path: Path) -> None:
    usual = _run(tmp_path / "a", 10)
    other = _run(tmp_path / "b", 20, {"adversary_actions": "mode"}, seed=1)
    third = _run(tmp_path / "c", 30, {"victim": {"name": "baseline:zero/7x2", "sha256": "z"}}, seed=2)
    found = _gather(usual, other, third)
    assert sorted(_numbers(found)) == [[0.1], [0.2], [0.3]]
    how = {(setting.adversary_actions, setting.victim) for setting in found.settings}
    assert how == {("sample", "default"), ("mode", "default"), ("sample", "baseline:zero/7x2")}


def test_a_victim_that_was_defended_is_another_number(tmp_path: Path) -> None:
    masked = {"observers": {"masked_observation": {"way": "noise"}}}
    found = _gather(_run(tmp_path / "a", 10), _run(tmp_path / "b", 20, masked, seed=1))
    assert sorted(_numbers(found)) == [[0.1], [0.2]]
    told = [setting.axes.get("scored with masked_observation") for setting in found.settings]
    assert told == [None, "way=noise"]


def test_what_a_victim_was_defended_by_in_training_is_told_with_its_options(tmp_path: Path) -> None:
    runs = [
        _run(
            tmp_path / way,
            10,
            {"observers": {"masked_observation": {"way": way}}},
            observers=("masked_observation",),
            options={"masked_observation": {"way": way}},
        )
        for way in ("zeros", "noise")
    ]
    found = _gather(*runs)
    assert len(_numbers(found)) == 2
    told = {setting.axes["observers"] for setting in found.settings}
    assert told == {f"masked_observation (way={way}, share=0.5)" for way in ("zeros", "noise")}
    assert not any(setting.changes_method for setting in found.settings)


def test_physics_are_two_numbers(tmp_path: Path) -> None:
    faithful = _run(tmp_path / "a", 10, {"game_settings": {"physics": "faithful"}})
    fast = _run(tmp_path / "b", 20, {"game_settings": {"physics": "fast"}}, seed=1)
    assert sorted(_numbers(_gather(faithful, fast))) == [[0.1], [0.2]]


def test_physics_of_training_and_of_the_score_are_told_apart(tmp_path: Path) -> None:
    """Both scored in the game as it was made, one trained in cheaper physics."""
    score = {
        "env": KICK,
        "victim": {"name": VICTIMS[KICK], "sha256": ""},
        "game_settings": {"physics": "faithful"},
    }
    own = {"env": KICK, "victim": VICTIMS[KICK]}
    faithful = _run(tmp_path / "a", 10, score, game={"physics": "faithful"}, **own)
    fast = _run(tmp_path / "b", 20, score, seed=1, game={"physics": "fast"}, **own)
    found = _gather(faithful, fast)
    assert sorted(_numbers(found)) == [[0.1], [0.2]]
    told = {(setting.trained_physics, setting.physics) for setting in found.settings}
    assert told == {("faithful", "faithful"), ("fast", "faithful")}
    assert any("Trained in fast physics" in warning.text for warning in found.warnings)


def test_the_curve_of_a_run_belongs_to_the_games_it_was_trained_in(tmp_path: Path) -> None:
    """Scored in the game as it was made, too: tables put that first."""
    victim = {"env": KICK, "victim": {"name": VICTIMS[KICK], "sha256": ""}}
    score = {**victim, "game_settings": {"physics": "fast"}}
    run = _run(tmp_path / "a", 10, score, env=KICK, victim=VICTIMS[KICK], game={"physics": "fast"})
    own = {"trained_steps": 2000, "game_settings": {"physics": "faithful"}, "victim": victim["victim"]}
    write_score(run.path, "faithful", result(KICK, 20, 0, 100, **own))
    found = _gather(run)
    physics = {setting.id: setting.physics for setting in found.settings}
    assert sorted(physics.values()) == ["faithful", "fast"]
    assert [physics[panel.setting] for panel in found.curves] == ["fast"]
    assert [physics[course.setting] for course in found.diagnostics] == ["fast"]


def test_settings_of_the_learner_are_two_numbers_with_their_names(tmp_path: Path) -> None:
    found = _gather(_run(tmp_path / "a", 10), _run(tmp_path / "b", 20, seed=1, reward={"sparse_weight": 0.5}))
    assert sorted(_numbers(found)) == [[0.1], [0.2]]
    assert any("reward.sparse_weight=0.5" in setting.label for setting in found.settings)


def test_an_option_of_a_method_is_another_number_with_its_name(tmp_path: Path) -> None:
    """No axis of a benchmark: told by comparing the runs."""
    one = _run(tmp_path / "a", 10, method="e_apil")
    other = _run(tmp_path / "b", 20, method="e_apil", seed=1, options={"e_apil": {"beta": 2.0}})
    found = _gather(one, other)
    assert _numbers(found) == [[0.1], [0.2]]
    assert any("options.e_apil.beta 2.0 instead of" in setting.label for setting in found.settings)


def test_a_copy_is_no_second_seed(tmp_path: Path) -> None:
    found = _gather(_run(tmp_path / "a", 10, seed=3), _run(tmp_path / "b", 20, seed=3))
    assert _numbers(found) == [[0.1]]
    assert any(warning.kind == "copies" for warning in found.warnings)


def test_a_score_of_an_earlier_end_is_said_to_be_old(tmp_path: Path) -> None:
    found = _gather(_run(tmp_path / "a", 10, {"trained_steps": 1000}))
    assert any(warning.kind == "stale" for warning in found.warnings)


def test_an_adversary_that_has_not_learnt_is_said_so(tmp_path: Path) -> None:
    """50 of the first 100 training games won, and 55 of 100 in the end: noise; 90 would be none."""
    same, better = _gather(_run(tmp_path / "a", 55)), _gather(_run(tmp_path / "b", 90))
    assert any("not distinguishable" in warning.text for warning in same.warnings)
    assert not any("not distinguishable" in warning.text for warning in better.warnings)


def test_a_method_with_other_options_is_said_so_even_alone(tmp_path: Path) -> None:
    usual, other = (
        _gather(_run(tmp_path / name, 10, method="e_apil", options={"e_apil": {"beta": beta}}))
        for name, beta in (("usual", 1.0), ("other", 2.0))
    )
    text = f"e_apil in {TOY} has not its default options: options.e_apil.beta=2.0."
    assert [w.text for w in other.warnings if w.loud and w.column] == [text]
    assert not any(warning.loud and warning.column for warning in usual.warnings)


def test_what_was_not_scored_yet_warns_of_no_numbers(tmp_path: Path) -> None:
    """A long run at work beside a finished one: its budget is no budget of any number here."""
    done, working = _run(tmp_path / "a", 10), _run(tmp_path / "b", 10, steps=9_000_000)
    (working.path / "scores" / "plain.json").unlink()
    found = _gather(done, working)
    assert len(found.settings) == 2
    assert not any("9 M" in warning.text for warning in found.warnings if warning.kind == "budget")


def test_warnings_about_cells_of_two_settings_say_which(tmp_path: Path) -> None:
    found = _gather(_run(tmp_path / "a", 55), _run(tmp_path / "b", 55, {"trained_steps": 1000}))
    texts = [warning.text for warning in found.warnings if "not distinguishable" in warning.text]
    assert sorted(text.partition(":")[0] for text in texts) == ["1 k steps", "2 k steps"]


def test_a_method_defined_again_has_its_new_defaults() -> None:
    for gain in (1.0, 2.0):
        options = create_model("Options", gain=(float, gain))
        define(MethodSpec("again", type("Again", (Method,), {}), config=options))
        default = default_config(RunConfig(method="again", env="toy-pursuit"))
        assert default is not None
        assert default.options["again"]["gain"] == gain


def test_an_edited_one_file_plugin_has_its_new_defaults(tmp_path: Path) -> None:
    file = tmp_path / "edited_for_a_report.py"
    for gain in (1.0, 22.0):
        file.write_text(EDITED.format(gain=gain))
        default = default_config(RunConfig(method="edited", env="toy-pursuit", plugins=(str(file),)))
        assert default is not None
        assert default.options["edited"]["gain"] == gain
