"""Options of the episodic memory."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from apil_core import Section


class EpisodicConfig(Section):
    """The memory, and the weight of what it says."""

    revision: Annotated[float, Field(ge=0)] = 0.5
    """ε: weight of the change of the remembered return; 0: the game's reward."""
    pattern_length: Annotated[int, Field(gt=0)] = 10
    """k: steps a pattern averages over, and between two remembered ones of a game."""
    group_size: Annotated[int, Field(gt=0)] = 32
    """n: similar patterns whose returns are averaged."""
    capacity: Annotated[int, Field(gt=0)] = 4096
    """Patterns remembered; the oldest are replaced."""
    projection: Annotated[int, Field(gt=0)] = 16
    """p: length of a pattern."""
