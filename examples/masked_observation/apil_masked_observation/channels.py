"""Which columns of an observation the defence is about."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

from apil_core import ConfigError

if TYPE_CHECKING:
    import torch
    from torch import Tensor

    from apil_core import Context


def opponent_channels(context: Context) -> Tensor:
    """Indices of the columns that tell about the opponent of the side in ``context``, (k,) int64.

    Raises:
        ConfigError: the game does not say which they are.
    """
    channels = context.seat.opponent_channels
    if not channels:
        raise ConfigError(
            f"nothing to mask: the game does not say which channels of the {context.seat.name}'s observation "
            "tell about its opponent (SideLayout.opponent_channels)"
        )
    return _indices(channels, context.device)


@cache
def _indices(channels: tuple[int, ...], device: torch.device) -> Tensor:
    import torch

    return torch.tensor(channels, device=device)
