"""The four real methods, and a made-up game so that no test here needs mujoco."""

from __future__ import annotations

import sys
from types import ModuleType

import pytest

from apil_core import GameSpec, Section
from apil_core.plugins.discovery import PluginRegistry, discover


class MarginConfig(Section):
    margin: float = 0.5
    """How much larger a sum must be to win."""


@pytest.fixture(scope="session")
def found() -> PluginRegistry:
    return discover()


@pytest.fixture
def registry(found: PluginRegistry, monkeypatch: pytest.MonkeyPatch) -> PluginRegistry:
    module = ModuleType("made_up_game")
    module.MarginConfig = MarginConfig  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "made_up_game", module)
    game = GameSpec(
        name="kick-and-defend",
        factory="made_up_game:Game",
        default_victim="zoo:kick-and-defend/kicker/v1",
        config="made_up_game:MarginConfig",
    )
    ours = {name: found.methods[name] for name in ("adrl", "apil", "apl", "e_apil")}
    return PluginRegistry(
        records=found.records,
        methods=ours,
        games={game.name: game},
        recorders={name: found.recorders[name] for name in ("jsonl", "tensorboard")},
    )
