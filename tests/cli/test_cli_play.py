"""``apil play`` as a user meets it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import av
import numpy as np
import pytest
from envs.opengl import need_opengl
from PIL import Image

from apil_core import Window
from apil_core.common import colours
from apil_envs import gl
from apil_envs.toy import ToyPursuit
from cli.cli_helpers import COIN, Apil

TOY = ("random", "--env", "toy-pursuit")
SMALL = ("--width", "128", "--height", "96")
TWO = ("--episodes", "2")


def frames(path: Path) -> list[np.ndarray]:
    with av.open(str(path)) as container:
        return [frame.to_ndarray(format="rgb24") for frame in container.decode(container.streams.video[0])]


def test_a_video_of_every_game(apil: Apil, tmp_path: Path) -> None:
    done = apil("play", *TOY, *SMALL, "--episodes", "2", "--video", "film.mp4", "--json")
    assert done.code == 0, done.err
    result = json.loads(done.out)
    shown = frames(tmp_path / "film.mp4")
    # 20 steps a second: every step is a frame, and the end of each game is held 1.2 s
    assert len(shown) == sum(game["steps"] + 24 for game in result["games"])
    assert shown[0].shape == (96, 128, 3)
    assert result["wins"] + result["ties"] + result["losses"] == 2
    assert result["victim"]["name"] == "scripted:toy-pursuit/evader/v1"
    assert result["adversary"]["name"] == "baseline:random/7x2"
    assert result["game_options"] == {"max_steps": 50}
    assert result["video"] == "film.mp4"
    first = result["games"][0]
    assert set(first) == {
        *("number", "outcome", "cause", "steps", "seconds", "adversary_return", "victim_return")
    }
    last = shown[first["steps"] + 10][9:13, 40:88]  # the banner
    colour = {"win": colours.ADVERSARY, "loss": colours.VICTIM, "tie": colours.NEUTRAL}[first["outcome"]]
    assert (np.abs(last.astype(int) - colour).max(2) < 40).mean() > 0.3


def test_a_strip_and_the_same_games_as_the_video(apil: Apil, tmp_path: Path) -> None:
    film = json.loads(apil("play", *TOY, *SMALL, "--video", "film.mp4", "--json").out)
    strip = json.loads(apil("play", *TOY, *SMALL, "--snapshots", "4", "--out", "strip.png", "--json").out)
    assert film["games"] == strip["games"]
    assert film["seed"] == strip["seed"] == 0
    picture = Image.open(tmp_path / "strip.png")
    assert picture.width == 4 * 128 + 3 * 4
    assert 96 < picture.height < 140
    other = json.loads(apil("play", *TOY, *SMALL, "--snapshots", "4", "--seed", "1", "--json").out)
    assert other["games"] != strip["games"]
    assert (tmp_path / "snapshots.png").exists()


def test_people_read_who_won_and_how(apil: Apil) -> None:
    done = apil("play", "zero", "-e", "toy-pursuit", *SMALL, "--snapshots", "2")
    assert done.code == 0, done.err
    assert "adversary  pursuer, baseline:zero/7x2, actions sampled" in done.out
    assert "victim     evader, scripted:toy-pursuit/evader/v1, actions sampled" in done.out
    row = next(line for line in done.out.splitlines() if "escaped" in line).split()
    assert row[:3] == ["1", "victim", "escaped"]
    assert "snapshots  snapshots.png" in done.out


def test_until_shows_the_first_that_fits(apil: Apil) -> None:
    flags = (*TOY, *SMALL, "--set", "game.max_steps=40", "--json")
    every = json.loads(apil("play", *flags, "--snapshots", "1", "--episodes", "12").out)["games"]
    for outcome in {game["outcome"] for game in every}:
        shown = json.loads(
            apil("play", *flags, "--snapshots", "1", "--out", f"{outcome}.png", "--until", outcome).out
        )
        assert shown["games"] == [next(game for game in every if game["outcome"] == outcome)]


# --- a window


class Glass(Window):
    """A window that a test can look through; closed after so many moments."""

    def __init__(self, patience: int):
        self.patience = patience
        self.captions: list[str] = []
        self.closed = False

    @property
    def is_open(self) -> bool:
        return len(self.captions) < self.patience

    def show(self, caption: str) -> None:
        self.captions.append(caption)

    def close(self) -> None:
        self.closed = True


@pytest.mark.parametrize(("patience", "speed"), [(10_000, "100"), (3, "1")])
def test_a_window_shows_the_games_until_it_is_closed(
    apil: Apil, monkeypatch: pytest.MonkeyPatch, patience: int, speed: str
) -> None:
    glass = Glass(patience)
    asked = []
    monkeypatch.setattr(
        ToyPursuit, "open_window", lambda self, row, wanted: asked.append((row, wanted)) or glass
    )
    monkeypatch.setattr("apil_core.evaluation.video.viewers.HELD", 0.0)
    done = apil("play", *TOY, "--speed", speed, "--json")
    assert done.code == 0, done.err
    assert asked == [(0, (colours.VICTIM, colours.ADVERSARY))]
    assert glass.closed
    assert "0.00 s, step 0" in glass.captions[0]
    games = json.loads(done.out)["games"]
    assert len(games) == (1 if patience > 3 else 0)
    assert ("wins" in glass.captions[-1] or "tie:" in glass.captions[-1]) == (patience > 3)


# --- mistakes, each before anything is played

MISTAKES = {
    (*TOY,): "ToyPursuit has no window of its own; use --video FILE.mp4 or --snapshots N",
    (*TOY, "--video", "film.avi"): "film.avi: videos are .mp4 files",
    (*TOY, "--video", "nowhere/film.mp4"): "nowhere/film.mp4: its directory does not exist",
    (*TOY, "--video", "here.mp4"): "here.mp4 exists already; nothing is overwritten",
    (*TOY, "--video", "film.mp4", "--width", "127"): "must be even, got 127 × 540",
    (*TOY, "--video", "film.mp4", "--width", "0"): "width must be at least 1, got 0",
    (*TOY, "--video", "film.mp4", "--speed", "0"): "speed must be at least 0.001, got 0",
    (*TOY, "--video", "film.mp4", "--fps", "-3"): "fps must be at least 1, got -3",
    (*TOY, "--snapshots", "0"): "snapshots must be at least 1, got 0",
    (*TOY, "--snapshots", "51"): "snapshots must be at most 50, got 51",
    (*TOY, "--snapshots", "3", "--height", "100000"): "height must be at most 4096, got 100000",
    (*TOY, "--snapshots", "5", "--episodes", "1000"): "a contact sheet of 2416 × 323996 pixels is too large",
    (*TOY, "--snapshots", "3", "--out", "strip.pdf"): "snapshots are written to .png",
    (*TOY, "--snapshots", "3", "--episodes", "0"): "episodes must be at least 1, got 0",
    (*TOY, "--out", "strip.png"): "--out names the file of --snapshots N, which is missing",
    (*TOY, "--snapshots", "3", "--set", "game.max_stepz=3"): "did you mean",
    (*TOY, "--snapshots", "3", "--victim", "baseline:zero/8x2"): "takes 8 observations",
    (*TOY, "--snapshots", "3", "--victim", "randon"): "randon",
    (*TOY, "--snapshots", "3", "--seed", "-1"): "seed must be at least 0, got -1",
    (*TOY, "--snapshots", "3", "--checkpoint", "x"): "random is no run: there is no checkpoint to choose",
    ("random", "--snapshots", "3"): "--env GAME",
    ("randon", "--env", "toy-pursuit", "--snapshots", "3"): "neither a run directory nor a policy name",
    (*TOY, "--snapshots", "1", *SMALL, "--until", "win", "--quiet", *TWO): "none of 2 games was a win",
}


@pytest.mark.parametrize("words", MISTAKES, ids=lambda words: " ".join(words[2:]))
def test_mistakes_are_one_line(apil: Apil, tmp_path: Path, words: tuple[str, ...]) -> None:
    (tmp_path / "here.mp4").write_bytes(b"mine")
    done = apil("play", *words)
    assert done.code == 2
    assert MISTAKES[words] in done.err
    assert len(done.err.splitlines()) == 1
    assert not done.out
    assert [file.name for file in tmp_path.iterdir()] == ["here.mp4"]
    assert (tmp_path / "here.mp4").read_bytes() == b"mine"


def test_a_directory_that_cannot_be_written_to(apil: Apil) -> None:
    """/proc takes no files, not even from root."""
    done = apil("play", *TOY, "--video", "/proc/film.mp4")
    assert done.code == 2
    assert "/proc/film.mp4: cannot be written" in done.err
    assert done.err.count("\n") == 1


def test_a_game_that_cannot_be_drawn_says_so_before_playing(apil: Apil, trained: Path) -> None:
    for who in (("zero", "--env", "coin", "--plugin", COIN), (trained,)):
        done = apil("play", *who, "--snapshots", "2")
        assert (done.code, done.out) == (2, "")
        assert "CoinGame cannot be drawn" in done.err


def test_without_opengl_one_line_says_what_to_install(apil: Apil, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gl, "works", lambda backend, **_: False)
    monkeypatch.setattr("sys.platform", "linux")
    gl._first_working.cache_clear()
    done = apil("play", "zero", "--victim", "zero", "--env", "kick-and-defend", "--snapshots", "2")
    gl._first_working.cache_clear()
    assert done.code == 2
    assert done.err.count("\n") == 1
    assert "apt-get install libegl1" in done.err


def test_a_mujoco_game_on_a_machine_without_a_screen(
    apil: Apil, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    need_opengl()
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    flags = ("play", "random", "--victim", "zero", "-e", "kick-and-defend", "--set", "game.max_steps=6")
    done = apil(*flags)
    assert done.code == 2
    assert "no screen to open a window on; use --video FILE.mp4 or --snapshots N" in done.err
    done = apil(*flags, *SMALL, "--video", "film.mp4", "--json")
    assert done.code == 0, done.err
    game = json.loads(done.out)["games"][0]
    assert game["steps"] == 6
    assert game["seconds"] == pytest.approx(0.09)
    assert len(frames(tmp_path / "film.mp4")) == 3 + 40  # steps 0, 2, 4, and 6 for 1.2 s at 100/3 fps


def test_an_opengl_that_is_not_there_is_named() -> None:
    """MuJoCo loads it when it is imported, so any command may meet it."""
    code = "from apil_core import make_game; make_game('run-to-goal-ants', num_envs=1)"
    environment = {**os.environ, "MUJOCO_GL": "bogus"}
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    told = done.stderr.splitlines()[-1]
    assert told.startswith("apil_core.common.errors.PluginError: ")
    assert "MUJOCO_GL is set to 'bogus': install that OpenGL, or unset it" in told
