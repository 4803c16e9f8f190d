"""Hiding the opponent from the adversary, or from the victim (docs/methods.md §4).

Blinding measures how much of a score depends on the adversary seeing its opponent, or on the victim seeing
the adversary: wins through the victim's observation make an attack adversarial (Gleave et al. 2020, §5).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from apil_core.api.config import BlindMode
from apil_core.common.errors import ConfigError
from apil_core.common.seeds import stream_seed

if TYPE_CHECKING:
    from apil_core.evaluation.pairing import Pairing
from apil_core.evaluation.play import Blinding

STARTS = 1024
"""Minimum number of starting states in a mean observation."""

_SEED, _STREAM = 0, "blinding starts"
# not the evaluation's seed: the replacement depends on the game, not on the games played


def make_blinding(pairing: Pairing, mode: BlindMode, side: int, *, imitator: bool = False) -> Blinding:
    """Blind one side of a pairing. Plays no game, but reseeds and resets it.

    Args:
        pairing: its game names the channels about the opponent.
        mode: ``"zeros"``, or ``"initial"``: their mean over many starting states. (A game's own start
            would reveal the opponent's initial position throughout the game.)
        side: the blinded side.
        imitator: hide the opponent's observation and action too, which methods may also read.

    Raises:
        ConfigError: the game names no such channels.
    """
    layout = pairing.game.layout.sides[side]
    channels = layout.opponent_channels
    if not channels:
        raise ConfigError(
            f"cannot blind the {layout.name}: game {pairing.config.env!r} does not say which of its "
            "observation's channels tell about the opponent (SideLayout.opponent_channels)"
        )
    hidden = torch.zeros(layout.observation_size, dtype=torch.bool, device=pairing.device)
    hidden[list(channels)] = True
    sizes = [side.observation_size for side in pairing.game.layout.sides]
    if mode == "initial":
        typical = typical_start(pairing)
    else:
        typical = [torch.zeros(size, device=pairing.device) for size in sizes]
    return Blinding(hidden, typical[side], typical[1 - side] if imitator else None)


@torch.inference_mode()
def typical_start(pairing: Pairing, starts: int = STARTS) -> list[Tensor]:
    """Mean starting observation of side 0 and 1 after all filters, each (o,) float32.

    Args:
        pairing: its game is reseeded and reset.
        starts: minimum number of starting states.
    """
    game = pairing.game
    game.seed(stream_seed(_SEED, _STREAM))
    observation_filter = pairing.observation_filter(pairing.generators(_SEED, _STREAM))
    rounds = math.ceil(starts / game.num_envs)
    total: list[Tensor | float] = [0.0, 0.0]
    for _ in range(rounds):
        game.reset()
        for side, observation in enumerate(game.observations):
            seen = observation_filter(side, torch.from_numpy(observation).to(pairing.device))
            total[side] = total[side] + seen.double().mean(0)
    return [(torch.as_tensor(sums) / rounds).float() for sums in total]
