"""``apil bench speed`` as a user meets it."""

from __future__ import annotations

import io
import json
from contextlib import closing
from pathlib import Path

import pytest
from rich.console import Console

from apil_core.cli.speed_progress import BarWatch
from apil_core.plugins.registry import default_plugins
from apil_core.studies.speed.bench import measure
from apil_core.studies.speed.plan import SpeedRequest, make_plan
from cli.cli_helpers import COIN, Apil

SMALL = ("--env", "toy-pursuit", "--batch", "64", "--seconds", "0.01", "--threads", "1")


def test_tables_files_and_lines_of_progress(apil: Apil, tmp_path: Path) -> None:
    done = apil("bench", "speed", *SMALL, "--num-envs", "4,8", "--methods", "adrl", "--out", "speed")
    assert done.code == 0, done.err
    assert "toy-pursuit against scripted:toy-pursuit/evader/v1, 4 games, 1 thread, 3 rounds of 16" in done.out
    for words in ("+ rules, observations", "+ learning: training", "hooks, adrl: ", "memory of the process"):
        assert done.out.count(words) == 2
    assert "this game's physics cannot be timed alone" in done.out
    assert "physics alone" not in done.out
    lines = done.err.splitlines()
    assert lines[0] == (
        "measuring 2 settings: toy-pursuit, 4 games, 1 thread, …; adrl; "
        "physics, game, victim, collection, training, direct; 64 steps a block"
    )
    assert lines[2] == "1 of 2: toy-pursuit, 4 games, 1 thread"
    document = json.loads((tmp_path / "speed" / "speed.json").read_text())
    assert {row["num_envs"] for row in document["rows"]} == {4, 8}
    assert (tmp_path / "speed" / "speed.png").stat().st_size > 10_000
    again = apil("bench", "speed", *SMALL, "--num-envs", "4", "--out", "speed")
    assert again.code == 2
    assert again.err.startswith("apil: speed/speed.json exists already; choose another --out, or --force")


def test_json_and_silence(apil: Apil) -> None:
    flags = ("--methods", "e_apil", "--methods", "adrl", "--num-envs", "4", "--levels", "game,training")
    done = apil("bench", "speed", *SMALL, *flags, "--quiet", "--json")
    assert (done.code, done.err) == (0, "")
    document = json.loads(done.out)
    assert [(row["level"], row["method"]) for row in document["rows"]] == [
        ("game", None),
        ("training", "e_apil"),
        ("training", "adrl"),
    ]
    assert document["machine"]["versions"]["apil"]


def test_a_game_of_a_plugin(apil: Apil) -> None:
    flags = ("--env", "coin", "--plugin", COIN, "--num-envs", "4", "--batch", "64", "--seconds", "0.01")
    done = apil("bench", "speed", *flags, "--methods", "adrl", "--levels", "victim", "--quiet")
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
def test_mistakes_are_one_line(apil: Apil, tmp_path: Path, flags: tuple[str, ...]) -> None:
    (tmp_path / "file").write_text("")
    base = ("--num-envs", "4", "--batch", "64", "--seconds", "0.01", "--quiet")
    env = () if flags[0] == "--env" else ("--env", "toy-pursuit")
    done = apil("bench", "speed", *base, *env, *flags)
    assert done.code == 2
    assert done.err.startswith("apil: ")
    assert done.err.count("\n") == 1
    assert MISTAKES[flags] in done.err


def test_the_bar_says_what_goes_on() -> None:
    plugins = default_plugins()
    request = SpeedRequest(envs=["toy-pursuit"], methods=["adrl"], num_envs=[4], batch=64, seconds=0.01)
    cells = make_plan(request, plugins)
    screen = Console(file=io.StringIO(), force_terminal=True, width=150, color_system=None)
    with closing(BarWatch(cells, screen)) as watch:
        measure(cells, plugins, command=[], watch=watch, keep=lambda report: watch._bars.refresh())
    text = screen.file.getvalue()  # type: ignore[attr-defined]
    assert "measuring 1 setting: toy-pursuit, 4 games" in text
    assert "about 0:00 in all" in text
    assert "round 3, adrl" in text
