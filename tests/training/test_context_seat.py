"""Every context tells what its side's seat is: in training, in side games, and in evaluation."""

from __future__ import annotations

import sys
import types

from helpers.small_runs import small_config

from apil_core import Method, MethodSpec, evaluate, hookimpl, make_game, run
from apil_core.plugins.discovery import PluginRecord, discover

told: set[tuple[str, str, str, str]] = set()


class Watching(Method):
    """Notes which seat each hook was told of."""

    @hookimpl
    def filter_observation(self, context, side, obs):
        assert context.seat is not None
        assert obs.shape[1] == context.seat.observation_size
        told.add(("filter", context.mode, context.role, context.seat.name))

    @hookimpl
    def extend_observation(self, context, view):
        assert view.own.shape[1] == context.seat.observation_size
        told.add(("extend", context.mode, context.role, context.seat.name))


def test_hooks_are_told_whose_seat_it_is(tmp_path):
    module = types.ModuleType("plugin_watching")
    module.Watching = Watching
    sys.modules[module.__name__] = module
    module.register_methods = hookimpl(lambda: [MethodSpec("watching", "plugin_watching:Watching")])
    registry = discover()
    registry.add(PluginRecord("watching", "", "test"), module)
    told.clear()
    run(
        small_config("watching", steps=64, num_envs=8, ppo={"num_steps": 8, "epochs": 1}),
        out=tmp_path / "run",
        plugins=registry,
    )
    evaluate(tmp_path / "run", episodes=5, plugins=registry)
    game = make_game("toy-pursuit", num_envs=1, threads=1)
    victim, adversary = (side.name for side in game.layout.sides)
    game.close()
    assert told == {
        *(("filter", mode, "adversary", adversary) for mode in ("train", "eval")),
        *(("filter", mode, "victim", victim) for mode in ("train", "eval")),
        *(("extend", mode, "adversary", adversary) for mode in ("train", "eval")),
    }
