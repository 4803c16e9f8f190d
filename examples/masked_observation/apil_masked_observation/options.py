"""Options of the masked observation."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from apil_core import Section


class MaskedObservationOptions(Section):
    """Masking of the opponent in the victim's observation."""

    way: Literal["zeros", "mean", "noise", "dropout"] = "zeros"
    """What stands where the opponent was: zeros, its mean in training, N(0, 1), or zeros now and then."""
    share: Annotated[float, Field(ge=0, le=1)] = 0.5
    """For dropout: probability that a game's victim does not see its opponent at a step."""
