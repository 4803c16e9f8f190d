"""``python -m benchmarks.speed`` as a user meets it."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from cli.cli_helpers import COIN, Outcome
from docs.pages import ROOT

from speed.__main__ import main

Speed = Callable[..., Outcome]

SMALL = ("--env", "toy-pursuit", "--batch", "64", "--seconds", "0.01", "--threads", "1")


@pytest.fixture
def speed(capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Speed:
    """Call the command in this process, in an empty directory."""
    monkeypatch.chdir(tmp_path)

    def call(*arguments: str | Path) -> Outcome:
        capsys.readouterr()
        code = main([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        return Outcome(code, captured.out, captured.err)

    return call


def test_it_runs_from_a_checkout() -> None:
    command = [sys.executable, "-m", "benchmarks.speed", "--help"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.startswith("Usage: python -m benchmarks.speed")


def test_tables_files_and_lines_of_progress(speed: Speed, tmp_path: Path) -> None:
    done = speed(*SMALL, "--num-envs", "4,8", "--methods", "adrl", "--out", "speed")
    assert done.code == 0, done.err
    assert "toy-pursuit against scripted:toy-pursuit/evader/v1, 4 games, 1 thread, 3 rounds of 16" in done.out
    for words in ("+ rules, observations", "+ learning: training", "hooks, adrl: ", "memory of the process"):
        assert done.out.count(words) == 2
    assert "this game's physics cannot be timed alone" in done.out
    assert "physics alone" not in done.out
    lines = done.err.splitlines()
    assert lines[0] == (
        "measuring 2 settings: toy-pursuit, 4 games, 1 thread, …; adrl; "
        "physics, game, victim, collection, training; 64 steps a block"
    )
    assert lines[2] == "1 of 2: toy-pursuit, 4 games, 1 thread"
    document = json.loads((tmp_path / "speed" / "speed.json").read_text())
    assert {row["num_envs"] for row in document["rows"]} == {4, 8}
    assert (tmp_path / "speed" / "speed.png").stat().st_size > 10_000
    again = speed(*SMALL, "--num-envs", "4", "--out", "speed")
    assert again.code == 2
    assert again.err.startswith("apil: speed/speed.json exists already; choose another --out, or --force")


def test_json_and_silence(speed: Speed) -> None:
    flags = ("--methods", "apl", "--methods", "adrl", "--num-envs", "4", "--levels", "game,training")
    done = speed(*SMALL, *flags, "--quiet", "--json")
    assert (done.code, done.err) == (0, "")
    document = json.loads(done.out)
    assert [(row["level"], row["method"]) for row in document["rows"]] == [
        ("game", None),
        ("training", "apl"),
        ("training", "adrl"),
    ]
    assert document["machine"]["versions"]["apil"]


def test_a_game_of_a_plugin(speed: Speed) -> None:
    flags = ("--env", "coin", "--plugin", COIN, "--num-envs", "4", "--batch", "64", "--seconds", "0.01")
    done = speed(*flags, "--methods", "adrl", "--levels", "victim", "--quiet")
    assert done.code == 0, done.err
    assert "coin against baseline:zero/2x1" in done.out


MISTAKES = {
    ("--env", "toy-pursiut"): "unknown game 'toy-pursiut' (did you mean 'toy-pursuit'?",
    ("--methods", "adrl,apill"): "unknown method 'apill' (did you mean 'apil'?",
    ("--physics", "fast"): "game 'toy-pursuit' has no physics profiles; leave out --physics",
    ("--num-envs", "4,five"): "five",
    ("--levels", "game,,victim"): "an empty word between commas",
    ("--victim", "zoo:nothing"): "zoo:nothing",
    ("--out", "file"): "file",
}


@pytest.mark.parametrize("flags", MISTAKES, ids=" ".join)
def test_mistakes_are_one_line(speed: Speed, tmp_path: Path, flags: tuple[str, ...]) -> None:
    (tmp_path / "file").write_text("")
    base = ("--num-envs", "4", "--batch", "64", "--seconds", "0.01", "--quiet")
    env = () if flags[0] == "--env" else ("--env", "toy-pursuit")
    done = speed(*base, *env, *flags)
    assert done.code == 2
    assert done.err.startswith("apil: ")
    assert done.err.count("\n") == 1
    assert MISTAKES[flags] in done.err
