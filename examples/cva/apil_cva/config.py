"""CVA's options; README.md gives the source of each default."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from apil_core import Section


class SurrogateConfig(Section):
    """The surrogate of the victim's state-value function."""

    observes: Literal["adversary", "victim", "both"] = "adversary"
    """Whose observation it reads."""
    hidden: Annotated[tuple[Annotated[int, Field(gt=0)], ...], Field(min_length=1)] = (64, 64)
    """Hidden tanh layers; the last one is the input of curiosity."""
    learning_rate: Annotated[float, Field(gt=0)] = 3e-4
    """Adam's step size."""
    epochs: Annotated[int, Field(gt=0)] = 4
    """Passes over each rollout."""


class CuriosityConfig(Section):
    """Random network distillation."""

    input: Literal["surrogate", "adversary", "victim", "both"] = "surrogate"
    """surrogate: the surrogate's last hidden layer; else the normalised observation of that side."""
    hidden: tuple[Annotated[int, Field(gt=0)], ...] = (128, 128)
    """Hidden tanh layers of target and predictor; (): both are linear."""
    features: Annotated[int, Field(gt=0)] = 128
    """Outputs of target and predictor."""
    learning_rate: Annotated[float, Field(gt=0)] = 3e-4
    """Adam's step size of the predictor."""
    epochs: Annotated[int, Field(gt=0)] = 4
    """Passes over what the predictor is trained on."""
    fraction: Annotated[float, Field(gt=0, le=1)] = 0.25
    """Share of each rollout's steps the predictor is trained on."""
    normalize: bool = True
    """Divide the bonus by the running standard deviation of its discounted return."""


class CvaConfig(Section):
    """Weights of the three advantages, each normalised over the rollout."""

    curiosity_weight: Annotated[float, Field(ge=0)] = 0.5
    """β, of the bonus's advantage."""
    victim_weight: Annotated[float, Field(ge=0)] = 1.0
    """Of the victim's advantage, which is subtracted."""
    surrogate: SurrogateConfig = SurrogateConfig()
    curiosity: CuriosityConfig = CuriosityConfig()
