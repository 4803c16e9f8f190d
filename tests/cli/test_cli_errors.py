"""Bad input: one line on stderr, an exit code, nothing written."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from cli.cli_helpers import COIN, SMALL, TINY, Apil

WRONG = {
    ("fly",): 'Unknown command "fly"',
    ("run", "--fast"): "Unknown option: --fast",
    (
        "run",
        "--steps",
        "1.5",
    ): "Invalid value for --steps: '1.5' is not a whole number (see: apil run --help)",
    ("run", "--num-envs", "1.5"): "Invalid value for --num-envs: '1.5' is not a whole number",
    ("run", "--seed", "2.5"): "Invalid value for --seed: '2.5' is not a whole number",
    ("run", "--seed", "null"): "Invalid value for --seed: 'null' is not a whole number",
    ("eval", "nowhere", "--episodes", "99.5"): "Invalid value for --episodes: '99.5' is not a whole number",
    ("analyze", "activations", "nowhere", "--seed", ".5"): "Invalid value for --seed: '.5' is not a whole",
    ("run", "--num-envs", "1000000000"): "--num-envs 1000000000: should be less than or equal to",
    ("run", *TINY, "--set", "ppo.num_steps=1000000000"): "should be less than or equal to 1048576",
    ("run", *TINY, "--set", "ppo.hidden=[]"): "--set ppo.hidden=[]: tuple should have at least 1 item",
    ("run", *TINY, "--set", "ppo.hidden=[0]"): "--set ppo.hidden=[0]: ppo.hidden.0: should be greater than 0",
    ("run", *TINY, "--set", "ppo.hidden=[64, -1]"): "ppo.hidden.1: should be greater than 0, got -1",
    ("run", *TINY, "--set", "options.apil.imitator.hidden=[]"): "should have at least 1 item",
    ("run", "--workers", "2"): "--workers: trainings at a time, so it needs --seeds",
    ("run", "--seeds", "3..1"): "Invalid value for --seeds: '3..1' names no seed, or one twice",
    ("run", "--method", "e_apill", "--env", "coin", "--plugin", str(COIN)): (
        "--method e_apill: unknown method 'e_apill' (did you mean 'e_apil'? known: adrl, "
    ),
    ("run", "--env", "coim", "--plugin", str(COIN)): "--env coim: unknown game 'coim' (did you mean 'coin'?",
    ("run", "--preset", "papper"): "unknown preset 'papper' (did you mean 'paper'?",
    ("run", "--config", "none.yaml"): "none.yaml: no such file",
    ("run", "--plugin", "none.py"): "no such file",
    ("run", *TINY, "--set", "ppo.epoch=3"): "--set ppo.epoch=3: unknown key (did you mean 'epochs'?)",
    ("run", *TINY, "--set", "version=9"): (
        "--set version=9: is 9, newer than this apil understands (1): upgrade apil"
    ),
    ("run", *TINY, "--victim", "zooo:x"): "unknown policy 'zooo:x'",
    ("run", *TINY, "--victim", "zoo:kick-and-defend/kicker/v9"): "unknown victim",
    ("run", *TINY, "--device", "gpu"): "--device gpu: unknown device 'gpu'",
    ("run", *TINY, "--init-from", "nowhere"): "is no run directory",
    ("resume", "nowhere"): "nowhere is no run directory (no config.yaml in it)",
    ("eval", "nowhere"): "nowhere is neither a run directory nor a policy name",
    ("eval", "zoo:kick-and-defend/kicker/v1"): "--env GAME",
    ("runs", "compare", "nowhere"): "nowhere is no run directory (no config.yaml in it)",
    ("victims", "import", "nowhere"): "no agents of the zoo below nowhere",
    ("victims", "download", "--game", "chess"): "unknown game 'chess'",
    ("config", "validate", "none.yaml"): "none.yaml: no such file",
    ("config", "diff", "paper", "quik"): "unknown preset 'quik' (did you mean 'quick'?",
}


@pytest.mark.parametrize("arguments", list(WRONG), ids=" ".join)
def test_a_mistake_is_one_line(apil: Apil, tmp_path: Path, arguments: tuple[str, ...]) -> None:
    done = apil(*arguments)
    assert done.code == 2
    assert done.out == ""
    assert done.err.startswith("apil: ")
    assert done.err.count("\n") == 1
    assert WRONG[arguments] in done.err
    assert list(tmp_path.iterdir()) == []


def test_a_game_that_exits_is_no_success(apil: Apil, tmp_path: Path) -> None:
    source = COIN.read_text().replace("self.clock += active", "raise SystemExit(0)")
    game = tmp_path / "leaving_game.py"
    game.write_text(source.replace('"coin"', '"leaving"').replace("coin_game:", "leaving_game:"))
    done = apil(
        "run",
        *TINY[4:],
        *SMALL,
        "--plugin",
        game,
        "--env",
        "leaving",
        "--method",
        "adrl",
        "--out",
        "r",
        "--quiet",
    )
    assert (done.code, done.out) == (1, ""), done.err
    assert re.fullmatch(
        r"apil: .*leaving_game\.py, line \d+: code that a run uses ended the program \(exit 0\)\n", done.err
    )


def test_missing_weights_name_the_two_commands_that_get_them(apil: Apil) -> None:
    done = apil("run", *TINY, "--victim", "zoo:kick-and-defend/kicker/v1")
    assert done.code == 2
    assert "apil victims import DIR" in done.err
    assert "apil victims download" in done.err


def test_several_mistakes_are_several_lines(apil: Apil, tmp_path: Path) -> None:
    file = tmp_path / "run.yaml"
    file.write_text("methd: apil\nppo:\n  epochs: 0\n")
    done = apil("config", "validate", file, "--plugin", COIN)
    assert done.code == 2
    assert [line.split(": ", 2)[1:] for line in done.err.splitlines()][:1] == [
        [f"{file}:1", "methd: unknown key (did you mean 'method'?)"]
    ]
    assert all(line.startswith("apil: ") for line in done.err.splitlines())


def test_validate_as_json_says_what_is_wrong_on_stdout(apil: Apil, tmp_path: Path) -> None:
    file = tmp_path / "run.yaml"
    file.write_text("env: coin\nppo:\n  epochs: 0\n")
    done = apil("config", "validate", file, "--plugin", COIN, "--json")
    assert (done.code, done.err) == (2, "")
    assert json.loads(done.out) == {
        "file": str(file),
        "valid": False,
        "errors": [f"{file}:3: ppo.epochs: should be greater than 0, got 0"],
    }


@pytest.mark.parametrize("seeds", [(), ("--seeds", "0..2")])
def test_an_existing_output_directory_is_left_alone(
    apil: Apil, tmp_path: Path, seeds: tuple[str, ...]
) -> None:
    out = tmp_path / "out"
    kept = out / "s2" / "notes.txt" if seeds else out / "notes.txt"
    kept.parent.mkdir(parents=True)
    kept.write_text("mine")
    done = apil("run", *TINY, *SMALL, *seeds, "--out", out)
    assert done.code == 2
    assert f"{out} exists and is not empty" in done.err
    assert [path for path in out.rglob("*") if path.is_file()] == [kept]


def test_a_broken_plugin_file_is_named(apil: Apil, tmp_path: Path) -> None:
    broken = tmp_path / "broken_plugin.py"
    broken.write_text("import no_such_module\n")
    done = apil("run", "--plugin", broken)
    assert done.code == 2
    assert done.err.startswith(
        f"apil: --plugin {broken}: ModuleNotFoundError: No module named 'no_such_module'"
    )


def test_an_unexpected_error_leaves_its_traceback_in_a_file(
    apil: Apil, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("apil_core.plugins.discovery.discover", lambda files: 1 / 0)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    done = apil("methods")
    assert done.code == 1
    assert done.err.startswith("apil: unexpected ZeroDivisionError: division by zero (traceback: ")
    written = next(tmp_path.glob("apil-traceback-*.txt"))
    assert "ZeroDivisionError" in written.read_text()
    monkeypatch.setenv("APIL_DEBUG", "1")
    assert apil("methods").err.startswith("Traceback")
