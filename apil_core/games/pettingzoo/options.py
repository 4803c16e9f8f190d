"""Options of every ``pettingzoo:module:callable``."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, NonNegativeInt

from apil_core.api.config import Section


class PettingZooOptions(Section):
    """Options of a game made of a PettingZoo environment."""

    kwargs: dict[str, Any] = Field(default_factory=dict)
    """Keyword arguments of the callable."""
    max_steps: Annotated[int, Field(gt=0)] = 1000
    """Steps until time-out, if the environment has not ended the game before."""
    winner: Literal["reward", "info"] = "reward"
    """Winner: the agent with the larger total reward, or whose last info has "winner": true."""
    opponent_channels: dict[str, tuple[NonNegativeInt, ...]] = Field(default_factory=dict)
    """Per agent, the indices of its flattened observation that depend on the opponent (blinding)."""
