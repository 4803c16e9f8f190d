"""The games of a block once more, without the learner: how long they take with and without the victim."""

from __future__ import annotations

import time

import numpy as np
import torch

from apil_core.api.game import Array
from apil_core.api.types import Rollout, View
from apil_core.plugins.discovery import PluginRegistry
from apil_core.plugins.registry import make_game
from apil_core.policies.seats import run_victim
from apil_core.training.build import Attack

from .training import Start


class Replay:
    """A second set of games of the same kind, and a second victim.

    Args:
        attack: whose games are played again.
        plugins: to build them from.
    """

    def __init__(self, attack: Attack, plugins: PluginRegistry):
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
        """Steps and resets of the game with the recorded actions; returns their seconds."""
        self.game.load_state_dict(start.game)
        pairs = [self._seats(*actions) for actions in _actions(rollout)]
        begin = time.perf_counter()
        for pair in pairs:
            done = self.game.step(pair).done
            if done.any():
                self.game.reset(done)
        return time.perf_counter() - begin

    def play_victim(self, start: Start, rollout: Rollout) -> float:
        """The same, the victim choosing its actions anew after each step; returns the seconds."""
        self.game.load_state_dict(start.game)
        self.victim.load_recurrent_state(start.victim)
        self._generator.set_state(start.generator)
        recorded = _actions(rollout)
        victim_action = recorded[0][1]  # chosen before the block began
        begin = time.perf_counter()
        for action, _ in recorded:
            done = self.game.step(self._seats(action, victim_action)).done
            if done.any():
                self.game.reset(done)
            victim_action = self._act(done)
        return time.perf_counter() - begin

    @property
    def arrived(self) -> bool:
        """Whether the games stand bit for bit where the training's do."""
        pairs = zip(self.game.observations, self._attack.game.observations, strict=True)
        return all(np.array_equal(ours, theirs) for ours, theirs in pairs)

    def close(self) -> None:
        """Release the games."""
        self.game.close()

    @torch.inference_mode()
    def _act(self, done: Array) -> Array:
        device = self._attack.env.device
        observations = [torch.from_numpy(each).to(device) for each in self.game.observations]
        own, opponent = observations[1 - self._side], observations[self._side]
        view = View(own=own, opponent=opponent, first=torch.from_numpy(done).to(device))
        return self.victim.act(view, sample=self._sample, generator=self._generator).action.cpu().numpy()

    def _seats(self, action: Array, victim_action: Array) -> tuple[Array, Array]:
        return (action, victim_action) if self._side == 0 else (victim_action, action)


def _actions(rollout: Rollout) -> list[tuple[Array, Array]]:
    """Adversary's and victim's actions of every step, each (n, a)."""
    return list(zip(rollout.action.cpu().numpy(), rollout.victim_action.cpu().numpy(), strict=True))
