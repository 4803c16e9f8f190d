"""Playing a fixed number of games between two policies."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import torch
from torch import Tensor

from apil_core.api.game import Game
from apil_core.api.policy import Policy
from apil_core.api.types import View
from apil_core.games.two_players import TwoPlayerGames
from apil_core.training.observation_filter import ObservationFilter


@dataclass
class Seat:
    """One player of a pairing.

    Attributes:
        policy: of the seat.
        sample: draw actions, or take the mode.
        generator: source of the draws.
    """

    policy: Policy
    sample: bool
    generator: torch.Generator


@dataclass
class Players:
    """Both players, and the filters of their observations.

    Attributes:
        seats: of side 0 and 1.
        adversary_side: the side that acts second.
        device: of the policies.
        observation_filter: applied to both sides' observations.
        blinding: by side, applied to its view after that.
    """

    seats: tuple[Seat, Seat]
    adversary_side: int
    device: torch.device
    observation_filter: ObservationFilter | None = None
    blinding: dict[int, Blinding] = field(default_factory=dict)

    def start(self, game: Game) -> TwoPlayerGames:
        """Start all games of a batch, which the caller has seeded."""
        games = TwoPlayerGames(game, self.device, self.observation_filter)
        games.reset()
        return games

    def act(self, games: TwoPlayerGames) -> dict[int, Tensor]:
        """Actions by side for the current observations, each (n, a), not clipped.

        The victim acts first, so that an oracle adversary may see its action.
        """
        adversary, victim = self.adversary_side, 1 - self.adversary_side
        answer = self._choose(victim, games.view(victim))
        return {victim: answer, adversary: self._choose(adversary, games.view(adversary, answer))}

    def _choose(self, side: int, view: View) -> Tensor:
        seat = self.seats[side]
        if side in self.blinding:
            view = self.blinding[side](view)
        return seat.policy.act(view, sample=seat.sample, generator=seat.generator).action


@dataclass
class EpisodeCounts:
    """Outcomes of ended games. Side indices as in the game.

    Attributes:
        winners: per ended game: 0, 1 or −1 for a tie.
        causes: per ended game: index into ``GameLayout.causes``.
        lengths: per ended game: steps.
    """

    winners: list[int] = field(default_factory=list)
    causes: list[int] = field(default_factory=list)
    lengths: list[int] = field(default_factory=list)


@torch.inference_mode()
def play(
    game: Game, players: Players, episodes: int, on_progress: Callable[[int], None] | None = None
) -> EpisodeCounts:
    """Play exactly ``episodes`` games and count how they ended.

    Games are assigned to free slots in order until ``episodes`` have been started, and every started
    game is played to its end: short games are not over-represented.

    Args:
        game: seeded by the caller; its ``num_envs`` slots are used in parallel.
        players: both players.
        episodes: number of games.
        on_progress: called with the number of ended games whenever it grows.
    """
    counts = EpisodeCounts()
    slots = np.arange(game.num_envs)
    active = slots < episodes
    started = int(active.sum())
    games = players.start(game)
    while active.any():
        step = games.step(players.act(games), None if active.all() else active)
        done = np.logical_and(step.done, active)
        if not done.any():
            continue
        counts.winners += step.winner[done].tolist()
        counts.causes += step.cause[done].tolist()
        counts.lengths += step.lengths[done].tolist()
        again = done & (np.cumsum(done) <= episodes - started)
        started += int(again.sum())
        active &= ~done | again
        games.reset(again)
        games.first = torch.from_numpy(done).to(
            games.device
        )  # also in slots that get no further game: recordings skip those
        if on_progress is not None:
            on_progress(len(counts.winners))
    return counts


@dataclass(frozen=True)
class Blinding:
    """Replacement of a player's information on its opponent, constant over games and steps.

    Attributes:
        hidden: (o,) bool, the columns of its own observation that are replaced.
        own: (o,) float32, values of those columns; the others are not read.
        opponent: (o',) float32, replaces the opponent's observation, and zeros its action; ``None``: both
            are unchanged.
    """

    hidden: Tensor
    own: Tensor
    opponent: Tensor | None = None

    def __call__(self, view: View) -> View:
        """The blinded view; ``view`` itself is not changed."""
        own = torch.where(self.hidden, self.own, view.own)
        if self.opponent is None:
            return View(own, view.opponent, view.first, view.opponent_action)
        action = view.opponent_action
        return View(
            own=own,
            opponent=self.opponent.expand_as(view.opponent),
            first=view.first,
            opponent_action=None if action is None else torch.zeros_like(action),
        )
