"""Contact sheets and what is written into pictures."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from apil_core import ApilError
from apil_core.common import colours
from apil_core.evaluation.video import overlay
from apil_core.evaluation.video.contact_sheet import check_contact_sheet, chosen_steps, lay_out
from apil_core.evaluation.video.overlay import OverlayText
from apil_core.evaluation.video.single_game import Frame, Outcome, PlayedGame


def ended(outcome: Outcome) -> PlayedGame:
    return PlayedGame(
        number=1, outcome=outcome, cause="time-up", steps=9, seconds=0.45, adversary_return=1, victim_return=2
    )


def overlay_text(score: Counter[Outcome], name: str = "evader, zoo:x") -> OverlayText:
    return OverlayText(name, "pursuer, run:y", 2, score)


@pytest.mark.parametrize(
    ("steps", "snapshots", "chosen"),
    [(100, 5, [0, 25, 50, 75, 100]), (7, 3, [0, 4, 7]), (2, 5, [0, 1, 2]), (40, 1, [40])],
)
def test_snapshots_are_spread_evenly_and_end_at_the_end(
    steps: int, snapshots: int, chosen: list[int]
) -> None:
    assert chosen_steps(steps, snapshots) == chosen


def test_a_contact_sheet_has_a_row_for_every_game() -> None:
    rows = [
        [Image.new("RGB", (80, 60), (shade, shade, shade)) for shade in shades]
        for shades in ((10, 20, 30), (40, 50))  # a short game has fewer steps than snapshots
    ]
    picture = np.asarray(lay_out(rows, overlay_text(Counter(win=1, loss=1))))
    header = picture.shape[0] - (2 * 60 + 4)
    assert picture.shape[1] == 3 * 80 + 2 * 4
    assert 8 < header < 40
    shown = [
        [int(picture[header + 30 + 64 * row, 40 + 84 * column, 0]) for column in range(3)] for row in (0, 1)
    ]
    assert shown == [[10, 20, 30], [40, 50, 255]]
    assert tuple(picture[2, 0]) == colours.VICTIM
    assert tuple(picture[2, -1]) == colours.ADVERSARY


@pytest.mark.parametrize(
    ("name", "snapshots", "message"),
    [
        ("sheet.gif", 3, r"\.png"),
        ("sheet.webp", 40, "19356 × 320 pixels is too large"),
    ],
)
def test_what_cannot_be_written_is_said_before(name: str, snapshots: int, message: str) -> None:
    with pytest.raises(ApilError, match=message):
        check_contact_sheet(Path(name), snapshots, 1, (480, 320))


@pytest.mark.parametrize(
    ("outcome", "colour"), [("win", colours.ADVERSARY), ("loss", colours.VICTIM), ("tie", colours.NEUTRAL)]
)
def test_the_banner_has_the_winners_colour(outcome: Outcome, colour: tuple[int, int, int]) -> None:
    picture = Image.new("RGB", (320, 180), colour)
    overlay.banner(picture, ended(outcome))
    pixels = np.asarray(picture).reshape(-1, 3)
    white = (pixels.min(1) > 230).sum()
    assert white > 20, "the text"
    others = np.abs(pixels.astype(int) - colour).max(1) > 2
    assert others.sum() < 12 * white, "its ground cannot be told from the winner's colour"


def test_colours_go_by_role() -> None:
    assert colours.by_side(1) == (colours.VICTIM, colours.ADVERSARY)
    assert colours.by_side(0) == (colours.ADVERSARY, colours.VICTIM)


@pytest.mark.parametrize("width", [2, 40, 200, 960])
def test_long_names_stay_on_their_half_of_the_header(width: int) -> None:
    line = overlay.header(width, 16, overlay_text(Counter(), "a name far too long to fit " * 9)).convert(
        "RGB"
    )
    assert line.width == width
    middle = np.asarray(line)[:, width // 2 + 20 :]
    assert width < 200 or middle.max() > 100, "the adversary's name"


def test_a_window_says_all_in_words() -> None:
    score: Counter[Outcome] = Counter(win=2, tie=1, loss=1)
    text = overlay_text(score).all(Frame(2, 10, 0.5))
    assert text.splitlines() == [
        "victim (blue): evader, zoo:x",
        "adversary (red): pursuer, run:y",
        "victim 1 : 2 adversary, ties 1",
        "game 2, 0.50 s, step 10",
    ]
    assert overlay_text(score).all(Frame(2, 9, 0.45, ended("loss"))).endswith("victim wins: time-up")
