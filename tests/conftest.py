"""Fixtures all tests share."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

# before torch is imported: two test workers with a thread pool each would fight for two cores
os.environ.setdefault("OMP_NUM_THREADS", "1")

# what the tests run is not what this user has run
os.environ["XDG_STATE_HOME"] = tempfile.mkdtemp(prefix="apil-tests-")

import pytest
from hypothesis import settings

from apil_core import GameSpec, Section
from apil_core.plugins.defined import defined
from apil_core.plugins.discovery import PluginRegistry, discover

settings.register_profile("apil", deadline=None)  # nothing depends on the machine's load
settings.load_profile("apil")


class MarginConfig(Section):
    margin: float = 0.5
    """How much larger a sum must be to win."""


@pytest.fixture(scope="session")
def zoo_dir() -> Path:
    """Folder ``agent-zoo`` of the pretrained agents, in ``$APIL_ZOO`` or ``<repository>/../shared/zoo``."""
    beside = Path(__file__).resolve().parents[2] / "shared" / "zoo"
    root = Path(os.environ.get("APIL_ZOO", beside))
    for candidate in (root, root / "agent-zoo"):
        if (candidate / "kick-and-defend").is_dir():
            return candidate
    pytest.skip(f"no zoo weights in {root} (set APIL_ZOO to the folder agent-zoo)")


@pytest.fixture(autouse=True)
def _nothing_defined() -> Iterator[None]:
    """Methods that a test makes known to its process are not known to the next one."""
    yield
    defined.clear()


@pytest.fixture
def forgotten(tmp_path: Path) -> Iterator[None]:
    """Modules that a test imports from its folder are not known to the next one."""
    before = set(sys.modules)
    yield
    for name in set(sys.modules) - before:
        if str(getattr(sys.modules[name], "__file__", None)).startswith(str(tmp_path)):
            del sys.modules[name]


@pytest.fixture(scope="session")
def found() -> PluginRegistry:
    """All that is installed."""
    return discover()


@pytest.fixture
def registry(found: PluginRegistry, monkeypatch: pytest.MonkeyPatch) -> PluginRegistry:
    """The four real methods, and a made-up game that needs no MuJoCo."""
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
