"""Single games of a pairing: each is a function of the seed and its number, so it can be played again."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from pydantic import BaseModel

from apil_core.api.game import GameStep
from apil_core.common.seeds import stream_seed
from apil_core.evaluation.pairing import Pairing

Outcome = Literal["win", "tie", "loss"]
"""From the adversary's side, as in every score."""


class PlayedGame(BaseModel):
    """Outcome of one game. Returns are sums of sparse and dense rewards."""

    number: int
    outcome: Outcome
    cause: str
    steps: int
    seconds: float
    adversary_return: float
    victim_return: float


@dataclass(frozen=True)
class Frame:
    """A game at one step.

    Attributes:
        number: of the game, from 1.
        step: control steps played; 0 before the first.
        seconds: of simulated time.
        ended: the game's outcome, if this is its last frame.
    """

    number: int
    step: int
    seconds: float
    ended: PlayedGame | None = None


class SingleGames:
    """Plays games of a pairing one at a time.

    Args:
        pairing: made with ``num_envs=1``.
        seed: of everything random.
    """

    def __init__(self, pairing: Pairing, seed: int):
        self.pairing = pairing
        self.seed = seed

    @torch.inference_mode()
    def play(self, number: int, watch: Callable[[Frame], None] | None = None) -> PlayedGame:
        """Play game ``number`` of this seed; ``watch`` does not change it.

        Args:
            number: from 1.
            watch: called with every frame, from the start to the end.
        """
        game, watch = self.pairing.game, watch or (lambda frame: None)
        seed = stream_seed(self.seed, f"game {number}")
        game.seed(seed)
        players = self.pairing.players(seed)
        games = players.start(game)
        self._rewind(seed)
        returns = np.zeros(2)
        watch(Frame(number, 0, 0.0))
        while True:
            step = games.step(players.act(games))
            returns += step.sparse[:, 0] + step.dense[:, 0]
            steps = int(step.lengths[0])
            ended = self._ended(number, step, returns) if step.done[0] else None
            watch(Frame(number, steps, steps * game.seconds_per_step, ended))
            if ended is not None:
                return ended

    def find(
        self, outcome: Outcome, games: int, on_game: Callable[[PlayedGame], None] | None = None
    ) -> PlayedGame | None:
        """The first of so many games that ends like that; ``on_game`` is called with each one tried."""
        for number in range(1, games + 1):
            played = self.play(number)
            if on_game is not None:
                on_game(played)
            if played.outcome == outcome:
                return played
        return None

    def _rewind(self, seed: int) -> None:
        """Reseed both policies, stochastic hooks included, so that they repeat their draws."""
        pairing = self.pairing
        for side, policy in ((pairing.side, pairing.adversary), (1 - pairing.side, pairing.victim)):
            policy.seed(stream_seed(seed, f"hooks of side {side}"))

    def _ended(self, number: int, step: GameStep, returns: np.ndarray) -> PlayedGame:
        side, winner = self.pairing.side, int(step.winner[0])
        outcomes: dict[int, Outcome] = {side: "win", 1 - side: "loss"}
        steps = int(step.lengths[0])
        return PlayedGame(
            number=number,
            outcome=outcomes.get(winner, "tie"),
            cause=self.pairing.game.layout.causes[int(step.cause[0])],
            steps=steps,
            seconds=steps * self.pairing.game.seconds_per_step,
            adversary_return=float(returns[side]),
            victim_return=float(returns[1 - side]),
        )
