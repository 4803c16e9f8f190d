"""What the command-line tests share beside fixtures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from apil_core.cli import main

VERBS = (
    *("run", "resume", "eval", "play", "fidelity", "runs"),
    *(
        "crossplay",
        "analyze",
        "retrain",
        "distill",
        "export",
        "tune",
        "new",
        "config",
        "victims",
        "methods",
        "games",
        "plugins",
    ),
    *("bench", "doctor", "completion"),
)

COIN = Path(__file__).with_name("coin_game.py")

TINY = ("--env", "coin", "--plugin", str(COIN), "--num-envs", "8", "--steps", "256", "--threads", "1")
"""Flags of a training of 256 steps."""

SMALL = (
    *("--set", "ppo.num_steps=16", "--set", "ppo.epochs=1", "--set", "ppo.minibatches=2"),
    *("--set", "evaluation.episodes=20"),
)


@dataclass
class Outcome:
    """Exit code and output of one call."""

    code: int
    out: str
    err: str


def called(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> Outcome:
    """Call ``apil ARGUMENTS`` in this process."""
    capsys.readouterr()
    with pytest.raises(SystemExit) as caught:
        main([str(argument) for argument in arguments])
    captured = capsys.readouterr()
    return Outcome(int(caught.value.code or 0), captured.out, captured.err)


Apil = Callable[..., Outcome]
