"""Playing a fixed number of games between two policies."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import torch
from torch import Tensor

from apil_core.game import Game
from apil_core.observation_filter import ObservationFilter
from apil_core.policy import Policy
from apil_core.types import View


@dataclass
class Seat:
    """One player of a pairing.

    Attributes:
        policy: who plays.
        sample: draw actions, or take the mode.
        generator: source of the draws.
    """

    policy: Policy
    sample: bool
    generator: torch.Generator


@dataclass
class Tally:
    """How the games ended. Side indices as in the game.

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
    game: Game,
    seats: tuple[Seat, Seat],
    episodes: int,
    *,
    adversary_side: int,
    device: torch.device,
    observation_filter: ObservationFilter | None = None,
    on_progress: Callable[[int], None] | None = None,
) -> Tally:
    """Play exactly ``episodes`` games and count how they ended.

    Games are handed to free slots in order until ``episodes`` have been started, and every started
    game is played to its end: short games are not over-represented. The victim's seat acts first,
    so that an oracle adversary may see its action.

    Args:
        game: seeded by the caller; its ``num_envs`` slots are used in parallel.
        seats: players of side 0 and 1.
        episodes: number of games.
        adversary_side: who acts second.
        device: of the policies.
        observation_filter: applied to both sides' observations.
        on_progress: called with the number of ended games whenever it grows.
    """
    tally = Tally()
    slots = np.arange(game.num_envs)
    active = slots < episodes
    started = int(active.sum())
    game.reset()
    first = torch.ones(game.num_envs, dtype=torch.bool, device=device)
    order = (1 - adversary_side, adversary_side)
    while active.any():
        actions = _act(game, seats, order, first, device, observation_filter)
        step = game.step(actions, None if active.all() else active)
        done = np.logical_and(step.done, active)
        first = torch.from_numpy(done).to(device)
        if not done.any():
            continue
        tally.winners += step.winner[done].tolist()
        tally.causes += step.cause[done].tolist()
        tally.lengths += step.lengths[done].tolist()
        again = done & (np.cumsum(done) <= episodes - started)
        started += int(again.sum())
        active &= ~done | again
        if again.any():
            game.reset(again)
        if on_progress is not None:
            on_progress(len(tally.winners))
    return tally


def _act(
    game: Game,
    seats: tuple[Seat, Seat],
    order: tuple[int, int],
    first: Tensor,
    device: torch.device,
    observation_filter: ObservationFilter | None,
) -> tuple[np.ndarray, np.ndarray]:
    seen = [torch.from_numpy(observation).to(device) for observation in game.observations]
    if observation_filter is not None:
        seen = [observation_filter(side, observation) for side, observation in enumerate(seen)]
    chosen: dict[int, Tensor] = {}
    for side in order:
        view = View(
            own=seen[side], opponent=seen[1 - side], first=first, opponent_action=chosen.get(1 - side)
        )
        seat = seats[side]
        chosen[side] = seat.policy.act(view, sample=seat.sample, generator=seat.generator).action
    return chosen[0].cpu().numpy(), chosen[1].cpu().numpy()
