"""The live view, on a recorded screen."""

from __future__ import annotations

import io
import re
from pathlib import Path

import pytest
from rich.console import Console

from apil_core.api.config import RunConfig
from apil_core.cli import readout
from apil_core.cli.live import LiveProgress
from apil_core.cli.progress import PlainProgress, joined

METRICS = {
    "iteration": 3, "steps": 300, "total_steps": 1000, "steps_per_second": 100.0, "collect_seconds": 0.5,
    "update_seconds": 0.25, "window_games": 100, "window_wins": 30, "window_ties": 10, "window_losses": 60,
    "return/adversary": -1.5, "return/victim": 2.5, "episode_length": 40.0,
    "window_cause/goal": 75, "window_cause/time-up": 25, "cause/goal": 1, "cause/time-up": 9,
    "apil/discriminator_accuracy_victim": 0.8, "apil/discriminator_accuracy_imitator": 0.6,
    "apil/log_likelihood": -3.25, "apil/constant_log_likelihood": -4.0, "apil/relative_error": 0.25,
    "apil/explained_share": 0.8,
}  # fmt: skip

EXPECTED = (
    # Wilson by hand, 30 of 100, z = 1.96: centre (30 + 1.92) / (100 + 3.84) = .3074,
    # half width 1.96 / 103.84 · √(100·.3·.7 + .96) = .0885
    "win 30.0 % [21.9, 39.6]",
    "D right on victim 80%, imitator 60%",
    "error 0.25 of the best constant's",
    "explained share 80%",
    "log-likelihood -3.2 (constant -4.0)",
    "adversary -1.5, victim 2.5, game length 40.0",
    "goal 75%, time-up 25%",
)


def test_the_live_view_shows_the_games_and_the_imitator() -> None:
    screen = Console(file=io.StringIO(), force_terminal=True, width=150, color_system=None)
    with LiveProgress(screen) as progress:
        progress.started(RunConfig(steps=1000), Path("runs/x"), "zoo:v", 200)
        progress.iteration(METRICS)
        progress.evaluation_progress(5, 20)
        progress.note("a note")
        progress._live.refresh()
    text = " ".join(screen.file.getvalue().split())  # type: ignore[attr-defined]
    for part in (*EXPECTED, "300/1000", "5/20", "a note", "100 steps/s", "continued at 200 steps"):
        assert part in text


def test_a_view_that_never_started_closes_quietly() -> None:
    stream = io.StringIO()
    with LiveProgress(Console(file=stream, force_terminal=True)):
        pass
    assert stream.getvalue() == ""


def test_plain_lines_come_now_and_then() -> None:
    stream = io.StringIO()
    progress = PlainProgress(stream, every=3600)
    for iteration in (3, 4, 5):
        progress.iteration({**METRICS, "iteration": iteration})
    progress.iteration({**METRICS, "iteration": 10, "steps": 1000})
    lines = stream.getvalue().splitlines()
    starts = [place for place, line in enumerate(lines) if line.startswith("iteration ")]
    assert [lines[place].split(":")[0] for place in starts] == ["iteration 3", "iteration 10"]
    for part in (*EXPECTED, "300 of 1,000 steps", "0:07 left"):
        assert any(part in line for line in lines[: starts[1]]), part


@pytest.mark.parametrize("width", [60, 90, 300])
def test_lines_are_as_wide_as_the_screen_and_120_at_most(width: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", str(width))
    parts = readout.iteration(METRICS, "0:07")
    lines = joined(parts).splitlines()
    assert max(map(len, lines)) <= max(min(width, 120), 4 + max(map(len, parts)))
    assert all(line.startswith("    ") for line in lines[1:])
    assert " | ".join(line.strip() for line in lines) == " | ".join(parts)  # nothing is lost


def test_the_live_view_is_no_wider_than_120_columns(monkeypatch: pytest.MonkeyPatch) -> None:
    screen = Console(file=io.StringIO(), force_terminal=True, width=200, color_system=None)
    with LiveProgress(screen) as progress:
        progress.started(RunConfig(steps=1000), Path("runs/x"), "zoo:v", 200)
        progress.iteration(METRICS)
        progress._live.refresh()
    text = re.sub(r"\x1b\[[?0-9;]*[A-Za-z]", "", screen.file.getvalue())  # type: ignore[attr-defined]
    assert max(map(len, re.split(r"[\r\n]", text))) <= 120


def test_time_left_is_known_after_the_first_iteration() -> None:
    pace = readout.Pace()
    assert pace.left({"steps": 100, "total_steps": 7300, "steps_per_second": 100.0}) == "1:12"
    # 0.9 / 100 + 0.1 / 50 s a step, for 7100 steps
    assert pace.left({"steps": 200, "total_steps": 7300, "steps_per_second": 50.0}) == "1:18"
    assert pace.left({"steps": 7424, "total_steps": 7300, "steps_per_second": 100.0}) == "0:00"
    assert pace.games_left(0, 10) == "–"


def test_before_any_game_has_ended_there_are_no_shares() -> None:
    assert readout.outcomes({"window_games": 0}) == {}
    assert readout.endings({"cause/goal": 3, "window_cause/goal": 0}) == ""
    assert readout.imitator({}) == ""


@pytest.mark.parametrize(("seconds", "text"), [(5, "0:05"), (185, "3:05"), (7385, "2:03:05")])
def test_durations(seconds: float, text: str) -> None:
    assert readout.duration(seconds) == text
