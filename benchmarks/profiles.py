"""Speed of each physics setting relative to ``faithful``: the rows that ``docs/make_frontier.py`` reads.

The published agents play each other under every setting, in turns of ``--steps`` vectorised steps. Each
turn's physics is done again at once and timed alone, so a busy machine slows all settings alike. Restarts
are part of play and not of the clock.

    python benchmarks/profiles.py --env sumo-ants --setting '{"integrator": "Euler"}'
    python benchmarks/profiles.py --rounds 12 --out docs/results/physics_speed.jsonl      # all games, fast
"""

from __future__ import annotations

import argparse
import json
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch

from apil_core.common.errors import ApilError, ConfigError, VictimError
from apil_core.common.torch_threads import one_torch_thread
from apil_core.evaluation.pairing import Pairing, load_pairing
from apil_core.plugins.registry import default_plugins
from apil_envs.options import PhysicsOptions

WARM_UP = 60
"""Steps before timing starts: robots land and come into contact."""


class Contestant:
    """One game under one setting, played by the published agents.

    Attributes:
        options: of the game, as given.
        settings: values of the profile's keys that these options come to.
    """

    def __init__(self, env: str, options: dict[str, Any], num_envs: int, threads: int):
        self.options = options
        self.pairing = _pairing(env, options, num_envs, threads)
        game_options = self.pairing.game.options  # type: ignore[attr-defined]
        assert isinstance(game_options, PhysicsOptions)
        self.settings = asdict(game_options.resolved)
        game = self.pairing.game
        game.seed(0)
        self._players = self.pairing.players(0)
        self._games = self._players.start(game)
        watch = game.physics_stopwatch()
        assert watch is not None
        self._watch = watch
        self._play(WARM_UP)

    def turn(self, steps: int) -> float:
        """Environment steps per second of the physics alone over that many further steps."""
        self._watch.record()
        self._play(steps)
        self._watch.stop()
        return steps * self.pairing.game.num_envs / self._watch.replay()

    @torch.inference_mode()
    def _play(self, steps: int) -> None:
        for _ in range(steps):
            self._games.reset(self._games.step(self._players.act(self._games)).done)


def _pairing(env: str, options: dict[str, Any], num_envs: int, threads: int) -> Pairing:
    """The first of the game's published pairings with available weights."""
    missing = f"{env} has no published pairing"
    for matchup in default_plugins().game(env).matchups:
        try:
            return load_pairing(
                matchup.adversary,
                env=env,
                victim=matchup.victim,
                num_envs=num_envs,
                threads=threads,
                game_options=options,
            )
        except VictimError as error:
            missing = str(error)
    raise ConfigError(missing)


def measure(env: str, settings: list[dict[str, Any]], arguments: argparse.Namespace) -> list[dict[str, Any]]:
    """Measure one row per setting; ratios are paired with faithful's measurement in the same round."""
    with ExitStack() as stack, one_torch_thread():
        options: list[dict[str, Any]] = [{"physics": "faithful"}, *settings]
        contestants = [Contestant(env, each, arguments.num_envs, arguments.threads) for each in options]
        for contestant in contestants:
            stack.enter_context(contestant.pairing)
        rates = np.array([[c.turn(arguments.steps) for c in contestants] for _ in range(arguments.rounds)])
    rows = []
    for i, contestant in enumerate(contestants):
        low, ratio, high = np.quantile(rates[:, i] / rates[:, 0], [0.25, 0.5, 0.75])
        setting = contestant.settings
        rows.append({"env": env, "setting": setting, "ratio": ratio, "low": low, "high": high})
        print(
            f"{env:20} {np.median(rates[:, i]):7.0f} steps/s  x{ratio:.2f} [{low:.2f}, {high:.2f}]  {setting}"
        )
    return rows[1:]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--env", action="append", help="repeatable; default: all MuJoCo games")
    parser.add_argument("--setting", action="append", type=json.loads, default=[], help="JSON; repeatable")
    parser.add_argument("--num-envs", type=int, default=128)
    parser.add_argument("--threads", type=int, default=0)
    parser.add_argument("--steps", type=int, default=12)
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--out", type=Path, help="rows are appended; the last of a setting counts")
    arguments = parser.parse_args()
    games = [name for name, spec in default_plugins().games.items() if spec.matchups]
    settings = [{"physics": "fast"}, *arguments.setting]
    for env in arguments.env or games:
        rows = measure(env, settings, arguments)
        if arguments.out is not None:
            with arguments.out.open("a", encoding="utf-8") as file:
                file.writelines(json.dumps(row) + "\n" for row in rows)


if __name__ == "__main__":
    try:
        main()
    except ApilError as error:
        raise SystemExit(f"{error}") from None
