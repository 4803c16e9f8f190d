"""`apil distill` as a user meets it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from cli.cli_helpers import Apil

TOY = ("--env", "toy-pursuit", "--role", "evader", "--opponent", "baseline:random/7x2", "--steps", "1600")
SMALL = ("--num-envs", "16", "--threads", "1", "--episodes", "20", "--set", "final_passes=1")


def test_a_student_is_made_reported_and_can_be_attacked(apil: Apil, tmp_path: Path) -> None:
    done = apil("distill", *TOY, *SMALL, "--out", "student", "--quiet", "--json")
    assert done.code == 0, done.err
    report = json.loads(done.out)
    assert report["student_score"]["episodes"] == report["teacher_score"]["episodes"] == 20
    told = apil("distill", "--resume", "student", "--quiet")
    assert told.code == 0, told.err
    assert "scripted:toy-pursuit/evader/v1 → student/student.safetensors" in told.out
    assert "student minus teacher, win: " in told.out
    victim = f"safetensors:{tmp_path / 'student' / 'student.safetensors'}"
    score = apil(
        *("eval", "random", "--env", "toy-pursuit", "--victim", victim),
        *("--episodes", "20", "--threads", "1", "--quiet", "--json"),
    )
    assert score.code == 0, score.err
    result = json.loads(score.out)
    assert result["victim"] == {"name": victim, "sha256": report["student"]}


def test_a_teacher_may_be_code_that_is_named_here(apil: Apil, tmp_path: Path) -> None:
    code = "def flee(seen):\n    return -seen[:, 2:4].clamp(-1, 1), seen.new_zeros(2)\n"
    (tmp_path / "teaches_to_flee.py").write_text(code)
    players = ("--teacher", "python:teaches_to_flee:flee", "--opponent", "random")
    flags = ("--env", "toy-pursuit", "--role", "evader", *players, "--steps", "1600", *SMALL, "--out", "s")
    done = apil("distill", *flags, "--quiet", "--json")
    assert done.code == 0, done.err
    assert json.loads(done.out)["teacher"] == "python:teaches_to_flee:flee"
    settings = json.loads((tmp_path / "s" / "distillation.json").read_text())
    assert settings["opponent"] == "baseline:random/7x2"
    assert apil("distill", "--resume", "s", "--quiet").code == 0
    (tmp_path / "s").rename(tmp_path / "moved")
    (tmp_path / "moved" / "report.json").unlink()
    refused = apil("distill", "--resume", "moved", "--quiet")
    assert refused.code == 2
    assert "moved/distillation.json names it: name it on the command line, or add --trust" in refused.err


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (["--env", "toy-pursuit"], "say what to distill: --env GAME --role SIDE (or --resume DIR)"),
        (["--resume", "x", "--width", "3"], "--resume takes its settings from the directory"),
        (["--resume", "x"], "x is no distillation's directory (no distillation.json in it)"),
        ([*TOY, "--set", "final_pass=1"], "unknown key (did you mean 'final_passes'?)"),
        ([*TOY, "--set", "practice.max_step=1"], "max_step"),
        (
            ["--env", "toy-pursuit", "--role", "evader", "--steps", "0"],
            "--steps 0: should be greater than 0, got 0",
        ),
        (["--env", "toy-pursuit", "--role", "goalie"], "toy-pursuit has no side 'goalie'"),
        (
            ["--env", "toy-pursit", "--role", "evader"],
            "unknown game 'toy-pursit' (did you mean 'toy-pursuit'?",
        ),
    ],
)
def test_a_mistake_is_one_line_and_makes_nothing(
    apil: Apil, tmp_path: Path, flags: list[str], message: str
) -> None:
    done = apil("distill", *flags, *(() if "--resume" in flags else ("--out", "made")))
    assert (done.code, done.out) == (2, "")
    assert done.err.startswith("apil: ")
    assert done.err.count("\n") == 1
    assert message in done.err
    assert not (tmp_path / "made").exists()


def test_the_list_of_games_says_what_auto_means_here(apil: Apil) -> None:
    rows = {line.split()[0]: line for line in apil("games").out.splitlines() if line.strip()}
    assert "embedded:kick-and-defend/kicker/v1" in rows["kick-and-defend"]
    assert "scripted:toy-pursuit/evader/v1" in rows["toy-pursuit"]
    told = {spec["name"]: spec["victim_here"] for spec in json.loads(apil("games", "--json").out)}
    assert told["kick-and-defend"] == "embedded:kick-and-defend/kicker/v1"
