"""A distillation on the toy game: it learns, it can be stopped, and it says what is wrong."""

from __future__ import annotations

import json
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
import torch

from apil_core import ConfigError, RunDirError, VictimError, make_game
from apil_core.api.specs import GameSpec, Matchup
from apil_core.plugins.discovery import PluginRegistry, discover
from apil_core.policies.loading import load_victim
from apil_core.policies.student import load_file
from apil_core.runs.distillation.build import agent, named, prepare
from apil_core.runs.distillation.config import DistillConfig
from apil_core.runs.distillation.distill import distill, resume_distillation
from apil_core.runs.distillation.trainer import Entry


def config(**changes: Any) -> DistillConfig:
    small: dict[str, Any] = {
        "env": "toy-pursuit",
        "role": "evader",
        "opponent": "baseline:random/7x2",
        "steps": 2400,
        "num_envs": 16,
        "minibatch": 64,
        "final_passes": 2,
        "episodes": 0,
        "threads": 1,
    }
    return DistillConfig(**{**small, **changes})


class Stop(Exception):  # noqa: N818
    pass


@pytest.mark.slow
def test_the_student_comes_close_to_its_teacher_and_is_scored_beside_it(tmp_path: Path) -> None:
    report = distill(config(steps=8000, final_passes=10, episodes=60), out=tmp_path / "out")
    assert report.action_error.rms_sigma < 0.7 * report.action_error.constant_rms_sigma
    assert report.teacher == "scripted:toy-pursuit/evader/v1"
    student, teacher = report.student_score, report.teacher_score
    assert student is not None
    assert teacher is not None
    assert (student.episodes, teacher.episodes, student.adversary_side) == (60, 60, "evader")
    assert student.victim.name == teacher.victim.name == "baseline:random/7x2"
    assert report.win_difference is not None
    assert report.win_difference.value == pytest.approx((student.wins - teacher.wins) / 60)
    kept = load_file(tmp_path / "out" / "student.safetensors", "student")
    assert kept.info.sha256 == report.student == student.adversary.sha256
    assert kept.info.provenance["teacher"] == "scripted:toy-pursuit/evader/v1"
    assert kept.info.provenance["teacher_score"].startswith(f"win {teacher.wins}, tie {teacher.ties}, ")
    assert not list((tmp_path / "out").glob("block-*")), "what was played is not needed any more"


@pytest.mark.parametrize(
    ("network", "stop_after"), [pytest.param("mlp", 1, marks=pytest.mark.slow), ("lstm", 4)]
)
def test_a_stopped_distillation_goes_on_bit_for_bit(tmp_path: Path, network: Any, stop_after: int) -> None:
    whole = distill(config(network=network), out=tmp_path / "whole")

    def stop(entry: Entry, stages: int) -> None:
        assert stages == 5
        if entry.stage == stop_after:
            raise Stop

    with pytest.raises(Stop):
        distill(config(network=network), out=tmp_path / "cut", on_stage=stop)
    torch.manual_seed(99)  # nothing may depend on the global generator's state
    stages: list[int] = []
    resumed = resume_distillation(tmp_path / "cut", on_stage=lambda entry, _: stages.append(entry.stage))
    assert stages == list(range(stop_after + 1, 6))
    assert resumed.student == whole.student
    assert resumed.action_error == whole.action_error
    (tmp_path / "cut" / "block-000.safetensors").touch()  # killed before the last one was deleted
    assert resume_distillation(tmp_path / "cut").student == whole.student, "a finished one just tells"
    assert not list((tmp_path / "cut").glob("block-*"))
    (tmp_path / "cut" / "report.json").write_text("{}")
    with pytest.raises(RunDirError, match=r"report.json is damaged or of another version: Field required"):
        resume_distillation(tmp_path / "cut")


def test_it_does_not_go_on_with_another_teacher(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def stop(entry: Entry, stages: int) -> None:
        raise Stop

    for seed in (0, 1):
        distill(config(seed=seed, final_passes=0), out=tmp_path / f"teacher-{seed}")
    file = Path("teacher-0/student.safetensors")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(Stop):
        distill(config(teacher=f"safetensors:{file}"), out=tmp_path / "cut", on_stage=stop)
    monkeypatch.chdir("/")  # names are kept in full
    (tmp_path / file).write_bytes((tmp_path / "teacher-1" / "student.safetensors").read_bytes())
    with pytest.raises(VictimError, match=r"the teacher safetensors:.* has changed since the distillation"):
        resume_distillation(tmp_path / "cut")


def test_practice_changes_what_is_learnt_from_and_no_score(tmp_path: Path) -> None:
    plugins = discover()
    with closing(prepare(named(config(practice={"max_steps": 5}), plugins), plugins)) as trainer:
        games = trainer.collector.game, trainer.practice.game
        assert [game.layout.max_steps for game in games] == [50, 5]


def test_the_first_block_standardises_itself_and_what_follows() -> None:
    plugins = discover()
    with closing(prepare(named(config(), plugins), plugins)) as trainer:
        trainer.advance()
        first = trainer.blocks[0].observation
        standard = trainer.standardize
        assert standard is not None
        moving = standard.std > 0.1
        assert moving.any()
        assert first[..., moving].mean((0, 1)).abs().max() < 0.2  # clipped at ±5, hence not quite 0
        assert (first[..., moving].std((0, 1)) - 1).abs().max() < 0.2
        trainer.advance()
        assert trainer.log[1].fresh_error is not None
        assert trainer.steps == 2 * 50 * 16


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"role": "runner"}, ConfigError, "toy-pursuit has no side 'runner'; its sides: evader, pursuer"),
        (
            {"opponent": "auto"},
            ConfigError,
            "toy-pursuit names no agent for the pursuer; name one with --opponent",
        ),
        (
            {"teacher": "baseline:zero/7x2"},
            VictimError,
            "baseline:zero/7x2 has no action distribution: its mean cannot be learnt",
        ),
    ],
)
def test_mistakes_are_found_before_anything_is_made(
    tmp_path: Path, changes: dict[str, Any], error: type[Exception], message: str
) -> None:
    with pytest.raises(error) as caught:
        distill(config(**changes), out=tmp_path / "out")
    assert str(caught.value) == message
    assert not (tmp_path / "out").exists()


def test_nothing_is_overwritten_and_a_stranger_is_not_resumed(tmp_path: Path) -> None:
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "file").write_text("mine")
    with pytest.raises(RunDirError, match="exists and is not empty"):
        distill(config(), out=tmp_path / "full")
    with pytest.raises(RunDirError, match=r"is no distillation's directory \(no distillation.json in it\)"):
        resume_distillation(tmp_path / "full")
    (tmp_path / "full" / "distillation.json").write_text(json.dumps({"env": 3}))
    with pytest.raises(RunDirError, match="is damaged or of another version"):
        resume_distillation(tmp_path / "full")


def test_one_that_an_older_version_began_is_refused_and_its_report_still_read(tmp_path: Path) -> None:
    """Until the blocks lay beside a run's checkpoints, the state was in ``state.pt``."""
    for name in ("begun", "finished"):
        distill(config(final_passes=0), out=tmp_path / name)
        (checkpoint,) = (tmp_path / name / "checkpoints").iterdir()
        checkpoint.rename(tmp_path / name / "state.pt")
        (tmp_path / name / "checkpoints").rmdir()
    (tmp_path / "begun" / "report.json").unlink()
    with pytest.raises(RunDirError, match=r"begun was begun by an older version; begin anew"):
        resume_distillation(tmp_path / "begun")
    student = load_file(tmp_path / "finished" / "student.safetensors", "student")
    assert resume_distillation(tmp_path / "finished").student == student.info.sha256


def test_a_damaged_block_is_named(tmp_path: Path) -> None:
    def stop(entry: Entry, stages: int) -> None:
        raise Stop

    with pytest.raises(Stop):
        distill(config(), out=tmp_path / "cut", on_stage=stop)
    block = tmp_path / "cut" / "block-000.safetensors"
    block.write_bytes(block.read_bytes()[:1000])
    with pytest.raises(RunDirError, match=r"block-000.safetensors is missing or damaged"):
        resume_distillation(tmp_path / "cut")


def test_who_stands_in_where_weights_are_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("APIL_CACHE", str(tmp_path))
    spec = GameSpec(
        name="g",
        factory="",
        default_victim="zoo:sumo-ants/fighter/v1",
        baseline_adversary="zoo:sumo-ants/fighter/v2",
        matchups=(
            Matchup("baseline:random/3x1", "x", stands_in_for="zoo:sumo-ants/fighter/v2"),
            Matchup("zoo:sumo-ants/fighter/v2", "x"),
        ),
    )
    plugins: PluginRegistry = discover()
    assert agent(spec, 1, plugins, "--opponent") == "baseline:random/3x1"
    assert agent(spec, 0, plugins, "--teacher") == "zoo:sumo-ants/fighter/v1", "loading it says what to do"


def test_a_student_fits_its_seat(tmp_path: Path) -> None:
    distill(config(), out=tmp_path / "out")
    game = make_game("toy-pursuit", num_envs=1)
    name = f"safetensors:{tmp_path / 'out' / 'student.safetensors'}"
    assert load_victim(name, game, 0, "cpu", discover()).info.observation_size == 7
