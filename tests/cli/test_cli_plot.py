"""``apil runs plot``, and ``--show`` of ``apil run`` and ``apil resume``, as a user meets them."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import av
import pytest
from PIL import Image

from apil_core.cli.artifacts import make_artifacts
from apil_core.cli.finish import finish
from apil_core.evaluation.progress import Progress
from apil_core.runs.runner import RunResult
from apil_core.training.storage.run_dir import RunDir
from apil_envs import gl
from cli.cli_helpers import SMALL, TINY, Apil

TOY = (
    *("--env", "toy-pursuit", "--method", "apil", "--num-envs", "32", "--steps", "3k", "--threads", "1"),
    *("--set", "options.apil.imitator.minibatches=2", "--set", "options.apil.discriminator.minibatches=2"),
)
"""Flags of a training after which some 60 games have ended, 1 in 7 of them won."""

EVADER = "scripted:toy-pursuit/evader/v1"


# --- plot


def test_one_run_and_where_its_picture_is(apil: Apil, trained: Path, tmp_path: Path) -> None:
    done = apil("runs", "plot", trained)
    assert (done.code, done.out, done.err) == (0, "curve      curve.png\n", "")
    with Image.open(tmp_path / "curve.png") as picture:
        assert picture.width > 1000
    again = apil("runs", "plot", trained)
    assert again.code == 2
    assert again.err == "apil: curve.png exists already; choose another name, or --force to replace it\n"
    before = (tmp_path / "curve.png").read_bytes()
    assert apil("runs", "plot", trained, "--metric", "ppo/kl", "--force").code == 0
    assert (tmp_path / "curve.png").read_bytes() != before


def test_the_numbers_as_json(apil: Apil, trained: Path, tmp_path: Path) -> None:
    document = json.loads(apil("runs", "plot", "--out", "c.svg", trained, "--json").out)
    assert document["picture"] == "c.svg"
    ((group,),) = (document["groups"],)
    (curve,) = group["curves"]
    assert (group["label"], curve["victim"], curve["steps"]) == ("adrl", "baseline:zero/2x1", 256)
    assert set(curve["lines"]) == {"win", "win_or_tie", "return"}
    assert curve["scores"][0]["episodes"] == 20
    text = (tmp_path / "c.svg").read_text("utf-8")
    assert "adrl against baseline:zero/2x1 in coin" in text


MISTAKES = {
    ("trained", "--out", "c.jpg"): "c.jpg: curves are drawn as .png, .svg or .pdf files",
    ("trained", "--out", "nowhere/c.png"): "cannot write nowhere/c.png",
    ("trained", "--metric", "ppo/lk"): "trained has no metric 'ppo/lk' (did you mean 'ppo/kl'?)",
    ("trained", "trained"): "trained is named twice",
    ("trained", "nowhere"): "nowhere is no run directory (no config.yaml in it)",
    (): "DIR",
}


@pytest.mark.parametrize("words", MISTAKES, ids=" ".join)
def test_mistakes_are_one_line(apil: Apil, trained: Path, tmp_path: Path, words: tuple[str, ...]) -> None:
    before = sorted(tmp_path.rglob("*"))
    done = apil("runs", "plot", *words)
    assert (done.code, done.out) == (2, "")
    assert MISTAKES[words] in done.err
    assert done.err.count("\n") == 1
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.slow
def test_no_pyplot_no_screen_and_no_model_is_needed(trained: Path) -> None:
    code = (
        "import sys; from apil_core.cli import main\n"
        f"try: main(['runs', 'plot', {str(trained)!r}])\n"
        "except SystemExit as end: assert not end.code, end.code\n"
        "print([m for m in ('matplotlib.pyplot', 'mujoco', 'tkinter') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


def test_tables_of_runs_name_the_victim(apil: Apil, trained: Path) -> None:
    for words in (("list", trained), ("compare", trained)):
        row = next(line for line in apil("runs", *words).out.splitlines() if " adrl " in line).split()
        assert row[1:4] == ["adrl", "coin", "baseline:zero/2x1"]
    assert json.loads(apil("runs", "list", trained, "--json").out)[0]["victim"] == "baseline:zero/2x1"


# --- --show


def test_show_leaves_a_curve_and_a_won_game(apil: Apil, tmp_path: Path) -> None:
    done = apil("run", *TOY, *SMALL, "--out", "r", "--show")
    assert done.code == 0, done.err
    lines = [line.strip() for line in done.out.splitlines()]
    assert "run        r, 3,072 steps" in lines
    assert lines[-2:] == ["curve      r/curve.png", "won game   r/won-game.mp4"]
    own, unseen = (line for line in lines if line.startswith("this adversary"))
    assert (own.split()[2], unseen.split()[6]) == ("20", "20")
    (imitator,) = (line for line in lines if line.startswith("imitator   error "))
    assert "of the best constant's" in imitator
    assert "game 1 of 30: " in done.err
    with av.open(str(tmp_path / "r/won-game.mp4")) as film:
        assert sum(1 for _ in film.decode(film.streams.video[0])) > 24  # the end alone is held so long
    shown = json.loads(apil("resume", "r", "--steps", "4k", "--show", "--json", "--quiet").out)
    assert shown["steps"] == 4096
    assert shown["souvenirs"]["curve"] == "r/curve.png"
    unseen = shown["souvenirs"]["victim_blinded"]
    assert (unseen["blind_victim"], unseen["seed"]) == ("zeros", shown["evaluation"]["seed"])
    assert unseen["episodes"] == shown["evaluation"]["episodes"]
    assert shown["souvenirs"]["opponent"] is None  # toy-pursuit has none of its own
    names = {path.name for path in (tmp_path / "r").iterdir()}
    assert {"curve.png", "curve-3072.png", "won-game-3072.mp4", "result-3072.json"} <= names
    assert f"victim: {EVADER}" in (tmp_path / "r/config.yaml").read_text()


def test_without_show_nothing_is_drawn(apil: Apil, trained: Path) -> None:
    assert not list(trained.glob("curve*"))
    assert not list(trained.glob("*.mp4"))


def test_what_cannot_be_made_is_a_note_and_no_failure(apil: Apil, tmp_path: Path) -> None:
    """The coin game cannot be drawn; of 8 games there is no curve."""
    flags = ("--set", "ppo.num_steps=6", "--set", "evaluation.episodes=0", "--method", "adrl")
    done = apil("run", *TINY, *flags, "--set", "steps=40", "--out", "r", "--show", "--json", "--quiet")
    assert done.code == 0, done.err
    souvenirs = json.loads(done.out)["souvenirs"]
    assert (souvenirs["curve"], souvenirs["won_game"]) == (None, None)
    curve, film = done.err.splitlines()
    assert curve == (
        "apil: no learning curve: r/metrics.jsonl: 8 training games have ended, a curve needs 20"
    )
    assert film.startswith("apil: no video of a won game: CoinGame cannot be drawn")
    assert souvenirs["notes"] == [curve.removeprefix("apil: "), film.removeprefix("apil: ")]


def test_not_even_a_surprise_is_a_failure(apil: Apil, tmp_path: Path) -> None:
    """Else one full disk or one crash of OpenGL would cost the seeds that come after it."""
    assert apil("run", *TOY, *SMALL, "--out", "r", "--quiet").code == 0
    (tmp_path / "r" / "won-game.mp4").mkdir()
    made = make_artifacts(RunDir(tmp_path / "r"))
    assert made.won_game is None
    (note,) = made.notes
    assert note.startswith("no video of a won game: IsADirectoryError: ")


def test_without_opengl_one_line_says_what_to_install(apil: Apil, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gl, "works", lambda backend, **_: False)
    monkeypatch.setattr("sys.platform", "linux")
    gl._first_working.cache_clear()
    ants = ("--env", "run-to-goal-ants", "--victim", "zero", "--num-envs", "4", "--steps", "16")
    brief = ("--set", "ppo.num_steps=4", "--set", "ppo.minibatches=2", "--set", "evaluation.episodes=0")
    done = apil("run", *ants, *brief, "--method", "adrl", "--threads", "1", "--out", "r", "--show", "--quiet")
    gl._first_working.cache_clear()
    assert done.code == 0, done.err
    film = next(line for line in done.err.splitlines() if "video" in line)
    assert film.startswith("apil: no video of a won game: cannot draw: no OpenGL here")
    assert "apt-get install libegl1" in film


def test_an_adversary_that_never_wins(apil: Apil, tmp_path: Path) -> None:
    """Nobody is caught within two steps."""
    short = ("--set", "game.max_steps=2", "--set", "steps=1000")
    done = apil("run", *TOY, *short, *SMALL, "--out", "r", "--show", "--quiet")
    assert done.code == 0, done.err
    assert done.err.count("\n") == 1
    assert "no video of a won game: none of 30 games was a win of the adversary" in done.err
    assert (tmp_path / "r/curve.png").is_file()
    assert not [path.name for path in (tmp_path / "r").iterdir() if ".mp4" in path.name]


def test_an_interrupted_run_has_no_artifacts(capsys: pytest.CaptureFixture[str], trained: Path) -> None:
    stopped = RunResult(run_dir=trained, status="interrupted", steps=256, wall_seconds=1.0)
    assert "souvenirs" not in finish(stopped, Progress(), show=True, as_json=False)
    assert not list(trained.glob("curve*"))
    assert capsys.readouterr().out == ""
