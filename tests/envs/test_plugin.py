"""The package's registration: light to import, and everything it names exists."""

from __future__ import annotations

import subprocess
import sys

from apil_core import Game, Policy
from apil_core.api.specs import load
from apil_envs import plugin


def test_registering_imports_neither_torch_nor_mujoco() -> None:
    code = (
        "import sys; from apil_envs import plugin; plugin.register_games(); plugin.register_policies();"
        "sys.exit(int(bool({'torch', 'mujoco', 'numpy'} & set(sys.modules))))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_every_game_can_be_made() -> None:
    for spec in plugin.register_games():
        assert spec.config is not None
        game = load(spec.factory)(num_envs=1, threads=1, options=load(spec.config)())
        assert isinstance(game, Game)
        assert tuple(side.name for side in game.layout.sides) == spec.sides


def test_every_script_can_be_loaded() -> None:
    for spec in plugin.register_policies():
        assert spec.lister is not None
        for row in load(spec.lister)():
            policy = load(spec.loader)(row.name.partition(":")[2])
            assert isinstance(policy, Policy)
            assert policy.info.name == row.name
            assert policy.info.sha256 == row.sha256
