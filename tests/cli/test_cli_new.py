"""``apil new``: what it writes, what it says, and what it refuses."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from cli.cli_helpers import Apil
from cli.test_cli_help import LIGHT


def test_it_tells_the_next_three_commands(apil: Apil, tmp_path: Path) -> None:
    done = apil("new", "method", "my-idea", "--out", "work dir/idea")
    assert (done.code, done.err) == (0, "")
    first, following, *commands = done.out.splitlines()
    assert first == "work dir/idea: method my_idea, package apil_my_idea, 12 files"
    assert following == "next:"
    assert commands == [
        "  python -m pip install -e 'work dir/idea[test]'",
        "  python -m pytest 'work dir/idea'",
        "  apil run --config 'work dir/idea/config.yaml'",
    ]
    assert (tmp_path / "work dir" / "idea" / "apil_my_idea" / "method.py").is_file()


@pytest.mark.parametrize(
    ("kind", "name"), [("method", "my_idea"), ("game", "my-idea"), ("victim", "my-idea")]
)
def test_json_says_what_was_written(apil: Apil, tmp_path: Path, kind: str, name: str) -> None:
    done = apil("new", kind, "my_idea", "--json")
    assert (done.code, done.err) == (0, "")
    document = json.loads(done.out)
    assert (document["kind"], document["name"], document["package"]) == (kind, name, "apil_my_idea")
    assert document["directory"] == str(tmp_path / "my_idea")
    assert all((tmp_path / "my_idea" / file).is_file() for file in document["files"])
    assert len(document["next"]) == 3


def test_a_victim_gets_the_sizes_of_its_seat(apil: Apil, tmp_path: Path) -> None:
    done = apil("new", "victim", "foe", "--env", "kick-and-defend", "--side", "keeper")
    assert done.code == 0, done.err
    text = (tmp_path / "foe" / "make_weights.py").read_text()
    assert "INPUTS, OUTPUTS = 384, 17" in text
    assert "victim_side: 1" in (tmp_path / "foe" / "config.yaml").read_text()
    assert apil("config", "show", "--config", "foe/config.yaml").code == 0


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (
            ("method", "My Idea"),
            "'My Idea' is no name for a plugin: small letters, digits and single hyphens, "
            "beginning with a letter, e.g. 'my-idea'",
        ),
        (("method", "adrl"), "a method named 'adrl' exists already; try 'my-adrl'"),
        (("victim", "yield"), "'yield' is a word of Python's own; try 'my-yield'"),
        (("game", "json"), "'json': a Python module 'json' exists here already; try 'my-json'"),
        (("method", "idea", "--out", "full"), "full exists and is not empty; choose another --out"),
        (("method", "idea", "--out", "file"), "file exists and is a file; choose another --out"),
        (("method", "idea", "--out", "file/idea"), "file/idea cannot be made: {here}/file is a file"),
        (
            ("method", "idea", "--out", "/proc/idea"),
            "/proc/idea cannot be made: /proc: No such file or directory",
        ),
        (
            ("victim", "idea", "--side", "keeper"),
            "unknown side of toy-pursuit 'keeper' (known: evader, pursuer)",
        ),
    ],
)
def test_a_mistake_is_one_line_and_leaves_everything_as_it_was(
    apil: Apil, tmp_path: Path, arguments: tuple[str, ...], line: str
) -> None:
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine.txt").write_text("mine")
    (tmp_path / "file").write_text("mine")
    before = sorted(tmp_path.rglob("*"))
    done = apil("new", *arguments)
    assert (done.code, done.out, done.err) == (2, "", f"apil: {line.format(here=tmp_path)}\n")
    assert sorted(tmp_path.rglob("*")) == before
    assert (tmp_path / "full" / "mine.txt").read_text() == (tmp_path / "file").read_text() == "mine"


def test_an_unknown_kind_or_game_is_told(apil: Apil) -> None:
    for arguments in (("agent", "idea"), ("victim", "idea", "--env", "toy-persuit")):
        done = apil("new", *arguments)
        assert done.code == 2
        assert done.err.count("\n") == 1
    assert "toy-pursuit" in done.err


def test_an_empty_directory_is_filled_and_a_second_time_refused(apil: Apil, tmp_path: Path) -> None:
    assert apil("new", "game", "idea", "--out", ".").code == 0
    assert Path("config.yaml").is_file()  # still here, and not in a directory that is gone
    done = apil("new", "game", "idea", "--out", tmp_path)
    assert done.err == f"apil: {tmp_path} exists and is not empty; choose another --out\n"


def test_writing_imports_nothing_heavy(tmp_path: Path) -> None:
    command = [sys.executable, "-c", LIGHT, f"new victim foe --out {tmp_path / 'foe'}"]
    subprocess.run(command, stdout=subprocess.DEVNULL, check=True)
    assert (tmp_path / "foe" / "pyproject.toml").is_file()
