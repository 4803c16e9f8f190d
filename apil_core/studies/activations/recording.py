"""Record a victim's activations in whole games, all games in parallel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from apil_core.api.policy import Policy
from apil_core.api.types import Decision, View
from apil_core.common.errors import VictimError
from apil_core.common.seeds import stream_seed
from apil_core.evaluation.pairing import Pairing
from apil_core.evaluation.play import play
from apil_core.evaluation.progress import Progress

LAYER = "hidden"
"""Name of the last hidden layer, or an LSTM's h, among a policy's activations."""


@dataclass
class Recorded:
    """Activations of some games.

    Attributes:
        hidden: (rows, k) float32, one row for each step of each game.
        game: (rows,) int, which game a row is of; games count from 0.
    """

    hidden: NDArray[np.float32]
    game: NDArray[np.int64]

    def sample(self, each: int, seed: int) -> Recorded:
        """At most ``each`` rows of every game, drawn without replacement."""
        rows = even_sample(self.game, each, seed)
        return Recorded(self.hidden[rows], self.game[rows])

    def split(self, games: int) -> tuple[Recorded, Recorded]:
        """Split into the first ``games`` games and the others."""
        early = self.game < games
        return Recorded(self.hidden[early], self.game[early]), Recorded(
            self.hidden[~early], self.game[~early]
        )


class RecordingPolicy(Policy):
    """Acts exactly like another policy, and records its activations.

    Args:
        policy: the other one; it must tell its activations.
        games: how many will be played by :func:`.evaluation.play.play`, which hands them to free slots in
            order; later games of a slot are not recorded.

    Raises:
        VictimError: at its first action, if the policy is a black box.
    """

    def __init__(self, policy: Policy, games: int):
        self.info = policy.info
        self._policy, self._games, self._started = policy, games, 0
        self._number = np.zeros(0, np.int64)
        self._rows: list[Tensor] = []
        self._game: list[NDArray[np.int64]] = []

    def act(
        self,
        view: View,
        *,
        sample: bool,
        generator: torch.Generator | None = None,
        activations: bool = False,
    ) -> Decision:
        """See :meth:`apil_core.Policy.act`."""
        decision = self._policy.act(view, sample=sample, generator=generator, activations=True)
        hidden = activations_of(self._policy, decision)
        first = view.first.cpu().numpy()
        if first.all():
            self._number = np.zeros(len(first), np.int64)
        self._number[first] = self._started + np.arange(first.sum())
        self._started += int(first.sum())
        playing = self._number < self._games
        self._rows.append(hidden.cpu()[torch.from_numpy(playing)])  # a copy: the policy may reuse its tensor
        self._game.append(self._number[playing])
        return decision

    def recorded(self) -> Recorded:
        """The recorded activations, in the order of steps."""
        return Recorded(torch.cat(self._rows).float().numpy(), np.concatenate(self._game))

    def recurrent_state(self) -> dict[str, Any]:
        """See :meth:`apil_core.Policy.recurrent_state`."""
        return self._policy.recurrent_state()

    def load_recurrent_state(self, state: dict[str, Any]) -> None:
        """See :meth:`apil_core.Policy.load_recurrent_state`."""
        self._policy.load_recurrent_state(state)


def activations_of(policy: Policy, decision: Decision) -> Tensor:
    """Return the activations that came with a decision, (n, k).

    Raises:
        VictimError: the policy does not tell them.
    """
    hidden = (decision.activations or {}).get(LAYER)
    if hidden is None:
        raise VictimError(
            f"{policy.info.name} is a black box: it does not tell its activations (Policy.act with "
            "activations=True), so there is nothing to analyze"
        )
    return hidden


def check_has_activations(pairing: Pairing) -> None:
    """Check that the victim returns activations, with one action that is not played.

    Raises:
        VictimError: it does not.
    """
    game, side = pairing.game, 1 - pairing.side
    game.reset()
    own, opponent = (torch.from_numpy(game.observations[i]).to(pairing.device) for i in (side, 1 - side))
    first = torch.ones(len(own), dtype=torch.bool, device=pairing.device)
    decision = pairing.victim.act(View(own, opponent, first), sample=False, activations=True)
    activations_of(pairing.victim, decision)


def record(pairing: Pairing, games: int, seed: int, progress: Progress) -> Recorded:
    """Play ``games`` games and record the victim's activations; the games are those of an evaluation.

    Args:
        pairing: the game and both players; the game's generator is reseeded.
        games: number of games.
        seed: of the games and all draws.
        progress: gets the number of games played.
    """
    watched = RecordingPolicy(pairing.victim, games)
    pairing.victim = watched
    players = pairing.players(seed)
    pairing.game.seed(stream_seed(seed, "evaluation games"))
    play(pairing.game, players, games, lambda ended: progress.evaluation_progress(ended, games))
    return watched.recorded()


def even_sample(game: NDArray[np.int64], each: int, seed: int) -> NDArray[np.int64]:
    """Indices of at most ``each`` rows of every game, drawn without replacement, in ascending order.

    Args:
        game: (rows,), which game a row is of.
        each: rows of a game; a shorter game gives all it has.
        seed: of the draw.
    """
    lots = np.random.default_rng(seed).random(len(game))
    order = np.lexsort((lots, game))
    _, begins, counts = np.unique(game[order], return_index=True, return_counts=True)
    rank = np.arange(len(game)) - np.repeat(begins, counts)
    return np.sort(order[rank < each])


def game_means(values: NDArray[np.float64], game: NDArray[np.int64]) -> NDArray[np.float64]:
    """Mean of ``values`` (rows,) over the rows of each game, (games,)."""
    _, index, counts = np.unique(game, return_inverse=True, return_counts=True)
    means: NDArray[np.float64] = np.bincount(index, weights=values) / counts
    return means
