"""Players that note what they are shown and act whatever they see, so that two plays differ in views only."""

from __future__ import annotations

import numpy as np
import torch

from apil_core import Decision, Game, Policy, PolicyInfo, RunConfig, View
from apil_core.api.config import BlindMode
from apil_core.evaluation.blinding import make_blinding
from apil_core.evaluation.pairing import Pairing
from apil_core.evaluation.play import Blinding, play
from apil_core.plugins.hook_manager import RunHookManager


class Spy(Policy):
    """Draws actions from its seat's generator; keeps a copy of every view."""

    def __init__(self, observation_size: int, action_size: int):
        self.info = PolicyInfo("spy", "none", observation_size, action_size)
        self.views: list[View] = []

    def act(self, view: View, *, sample: bool, generator=None, activations: bool = False) -> Decision:
        action = view.opponent_action
        copy = None if action is None else action.clone()
        self.views.append(View(view.own.clone(), view.opponent.clone(), view.first.clone(), copy))
        return Decision(torch.randn(len(view.own), self.info.action_size, generator=generator))

    def seen(self, name: str) -> np.ndarray:
        """One part of all views, (steps, n, k)."""
        return torch.stack([getattr(view, name) for view in self.views]).numpy()


def spied_pairing(game: Game, side: int, hooks: RunHookManager | None = None) -> Pairing:
    """Two spies; the adversary sits on ``side``."""
    adversary, victim = (
        Spy(layout.observation_size, layout.action_size)
        for layout in (game.layout.sides[side], game.layout.sides[1 - side])
    )
    return Pairing(RunConfig(env="spied"), game, adversary, victim, side, hooks)


def play_spied(
    game: Game,
    side: int,
    blind: BlindMode | None,
    *,
    imitator: bool = False,
    hooks: RunHookManager | None = None,
    seed: int = 5,
    blind_side: int | None = None,
) -> tuple[Spy, Spy, Blinding | None]:
    """One game per slot; what adversary and victim were shown, and the blinding used."""
    pairing = spied_pairing(game, side, hooks)
    players = pairing.players(seed)
    if blind is not None:
        blinded = side if blind_side is None else blind_side
        players.blinding[blinded] = make_blinding(pairing, blind, blinded, imitator=imitator)
    game.seed(seed)
    play(game, players, game.num_envs)
    assert isinstance(pairing.adversary, Spy)
    assert isinstance(pairing.victim, Spy)
    return pairing.adversary, pairing.victim, players.blinding.get(side)
