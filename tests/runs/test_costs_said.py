"""What a run says beforehand: hours of training, and scores that cost more than the training."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from helpers.small_runs import small_config

from apil_core.evaluation.progress import Progress
from apil_core.runs.runner import run


class Notes(Progress):
    def __init__(self) -> None:
        self.lines: list[str] = []
        self.first: int | None = None

    def iteration(self, metrics: dict[str, float]) -> None:
        self.first = len(self.lines) if self.first is None else self.first

    def note(self, text: str) -> None:
        self.lines.append(text)
        if "hours to go" in text:
            raise KeyboardInterrupt


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"episodes": 20}, ""),  # 20 games of 50 steps, for 1024
        ({"episodes": 21}, "scores may cost more than the training: 21 games of up to 50 steps, for 1,024 "),
        (
            {"episodes": 0, "every_steps": 512, "periodic_episodes": 11},
            "scores may cost more than the training: 22 games of up to 50 steps, for 1,024 ",
        ),
    ],
)
def test_scores_that_cost_more_than_the_training(changes: Any, line: str, tmp_path: Path) -> None:
    notes = Notes()
    run(small_config("adrl", steps=1024, evaluation=changes), out=tmp_path / "r", progress=notes)
    assert [text[: len(line)] for text in notes.lines[: notes.first]] == ([line] if line else [])


def test_hours_are_said_after_the_first_iteration(tmp_path: Path) -> None:
    notes = Notes()
    with pytest.raises(KeyboardInterrupt):
        run(small_config("adrl", steps=10**10), out=tmp_path / "r", progress=notes)
    assert f"resume {tmp_path / 'r'} goes on" in notes.lines[-1]
    assert notes.lines[-1].startswith("about ")
    assert notes.first is not None
