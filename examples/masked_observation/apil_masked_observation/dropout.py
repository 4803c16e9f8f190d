"""Observer ``masked_dropout``: the columns about the opponent are zero half of the time."""

from __future__ import annotations

from typing import TYPE_CHECKING

from apil_core import hookimpl
from apil_masked_observation.channels import opponent_channels

if TYPE_CHECKING:
    from torch import Tensor

    from apil_core import Context

APIL_HOOK_API = 1
"""The hook API this module was written for."""

SHARE = 0.5
"""Probability that a game's victim does not see its opponent at a step."""


@hookimpl
def filter_observation(context: Context, side: int, obs: Tensor) -> Tensor | None:
    """The victim's observation (n, o), blank about its opponent in a random half of the games."""
    if context.role != "victim":
        return None
    channels = opponent_channels(context)
    drawn = obs.new_empty(len(obs), 1).uniform_(generator=context.generator)
    return obs.index_copy(1, channels, obs[:, channels] * (drawn >= SHARE))
