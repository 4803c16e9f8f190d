"""Options of the white-box attack; imports no torch."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from apil_core import Section


class SaliencyConfig(Section):
    """The weight of the victim's sensitivity."""

    weight: Annotated[float, Field(ge=0)] = 0.01
    """λ, in the reward's units per standard deviation of the victim's action."""
