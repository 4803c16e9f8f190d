"""Replay the games of a block without the learner, to time them with and without the victim."""

from __future__ import annotations

import time

import numpy as np
import torch

from apil_core.api.types import Rollout
from apil_core.games.two_players import TwoPlayerGames
from apil_core.plugins.discovery import PluginRegistry
from apil_core.plugins.registry import make_game
from apil_core.policies.loading import run_victim
from apil_core.training.build import RunParts

from .training import Start


class Replay:
    """A second set of games of the same kind, and a second victim.

    Args:
        attack: with the games to replay.
        plugins: to build them from.
    """

    def __init__(self, attack: RunParts, plugins: PluginRegistry):
        config = attack.config
        self._attack = attack
        self._side = attack.adversary_side
        self._sample = config.victim_actions == "sample"
        self._generator = torch.Generator(attack.env.device)
        self.game = make_game(
            config.env, num_envs=config.num_envs, threads=config.threads, options=config.game, plugins=plugins
        )
        self.game.seed(0)
        self.game.reset()
        self.victim = run_victim(config, self.game, plugins, config.seed)

    def play(self, start: Start, rollout: Rollout) -> float:
        """Replay steps and resets of the game with the recorded actions; return the seconds."""
        self.game.load_state_dict(start.game)
        recorded = {self._side: rollout.action, 1 - self._side: rollout.victim_action}
        pairs = list(zip(recorded[0].cpu().numpy(), recorded[1].cpu().numpy(), strict=True))
        begin = time.perf_counter()
        for pair in pairs:
            done = self.game.step(pair).done
            if done.any():
                self.game.reset(done)
        return time.perf_counter() - begin

    @torch.inference_mode()
    def play_victim(self, start: Start, rollout: Rollout) -> float:
        """Replay with the victim choosing its actions after each step; return the seconds."""
        self.game.load_state_dict(start.game)
        self.victim.load_recurrent_state(start.victim)
        self._generator.set_state(start.generator)
        games, opponent = TwoPlayerGames(self.game, self._attack.env.device), 1 - self._side
        chosen = rollout.victim_action[0]  # before the block began
        begin = time.perf_counter()
        for action in rollout.action:
            games.reset(games.step({self._side: action, opponent: chosen}).done)
            view = games.view(opponent)
            chosen = self.victim.act(view, sample=self._sample, generator=self._generator).action
        return time.perf_counter() - begin

    @property
    def arrived(self) -> bool:
        """Return whether the games' state equals the training's bit for bit."""
        pairs = zip(self.game.observations, self._attack.game.observations, strict=True)
        return all(np.array_equal(ours, theirs) for ours, theirs in pairs)

    def close(self) -> None:
        """Release the games."""
        self.game.close()
