"""A one-file plugin whose games misbehave, each in its own way, when they are made or drawn."""

from __future__ import annotations

import os
import signal
import time
from typing import Any

from apil_core import Game, GameSpec, PolicyListing, PolicySpec, VictimError, hookimpl


def killed(**_: Any) -> Game:
    os.kill(os.getpid(), signal.SIGKILL)
    raise AssertionError("unreachable")


def asleep(**_: Any) -> Game:
    time.sleep(60)
    raise AssertionError("too late")


def angry(**_: Any) -> Game:
    print("half a line", end="")
    raise RuntimeError("two\nlines")


def gone(**_: Any) -> Game:
    os._exit(7)


def load_policy(name: str) -> Any:
    raise VictimError("wild:angry/side/v1 is torn") if name.startswith("angry") else ZeroDivisionError(name)


def list_policies() -> list[PolicyListing]:
    return [PolicyListing(f"wild:{game}/side/v1", available=True) for game in ("angry", "gone")]


@hookimpl
def register_games() -> list[GameSpec]:
    victim = "wild:angry/side/v1"
    return [
        GameSpec(f"wild-{make.__name__}", f"wild_games:{make.__name__}", default_victim=victim)
        for make in (killed, asleep, angry, gone)
    ]


@hookimpl
def register_policies() -> list[PolicySpec]:
    return [PolicySpec("wild", "wild_games:load_policy", "wild_games:list_policies")]
