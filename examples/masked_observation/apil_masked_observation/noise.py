"""Observer ``masked_noise``: the columns about the opponent are noise."""

from __future__ import annotations

from typing import TYPE_CHECKING

from apil_core import hookimpl
from apil_masked_observation.channels import opponent_channels

if TYPE_CHECKING:
    from torch import Tensor

    from apil_core import Context

APIL_HOOK_API = 1
"""The hook API this module was written for."""


@hookimpl
def filter_observation(context: Context, side: int, obs: Tensor) -> Tensor | None:
    """The victim's observation (n, o) with N(0, 1) for its opponent; nothing for the adversary's."""
    if context.role != "victim":
        return None
    channels = opponent_channels(context)
    noise = obs.new_empty(len(obs), len(channels)).normal_(generator=context.generator)
    return obs.index_copy(1, channels, noise)
