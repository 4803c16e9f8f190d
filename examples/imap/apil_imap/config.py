"""IMAP's options. The README gives the sources of the defaults."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from apil_core import Section


class MimicConfig(Section):
    """Divergence: the network that follows the adversary's past policies."""

    hidden: tuple[int, ...] = (64, 64)
    """Hidden tanh layers."""
    learning_rate: Annotated[float, Field(gt=0)] = 1e-4
    """Adam's step size; the slower, the further back the average reaches."""
    epochs: Annotated[int, Field(gt=0)] = 4
    """Passes over each rollout."""
    minibatches: Annotated[int, Field(gt=0)] = 4
    """Parts of the rollout per pass."""
    max_grad_norm: Annotated[float, Field(gt=0)] = 0.5
    """Gradient clip."""


class ImapConfig(Section):
    """The bonus, its estimator, and its weight."""

    bonus: Literal["state_coverage", "policy_coverage", "risk", "divergence"] = "policy_coverage"
    """What is paid for: rare states of this rollout, states rare in all rollouts so far, a victim near
    where it began, or acting unlike one's own past."""
    xi: Annotated[float, Field(ge=0, le=1)] = 0.5
    """ξ: coverage: weight of the victim's states; 1 − ξ is the adversary's."""
    neighbours: Annotated[int, Field(gt=0)] = 10
    """Coverage: k of the nearest-neighbour estimate."""
    references: Annotated[int, Field(gt=0)] = 1024
    """Coverage: how many states, sampled evenly, the neighbours are looked for among."""
    projection: Annotated[int, Field(ge=0)] = 64
    """Coverage: length to which longer observations are projected at random; 0: never."""
    distance: Literal["log", "linear"] = "log"
    """Coverage: the bonus is log(1 + d) or d, d the mean distance to the neighbours."""
    tau: Annotated[float, Field(ge=0)] = 1.0
    """Weight of the intrinsic advantage before bias reduction."""
    bias_reduction: bool = True
    """Lower the weight while the objective falls short of what is expected of it."""
    objective: Literal["win_rate", "reward"] = "win_rate"
    """Bias reduction: share of ended games the adversary won, or its mean reward per step of the rollout."""
    min_games: Annotated[int, Field(gt=0)] = 100
    """Bias reduction: rollouts are taken together until so many games have ended (win_rate only)."""
    expected_growth: Annotated[float, Field(ge=1)] = 1.2
    """Bias reduction: factor by which the last objective is expected to be surpassed."""
    multiplier_rate: Annotated[float, Field(gt=0)] = 10.0
    """Bias reduction: step size of the Lagrange multiplier."""
    normalize: Literal["advantages", "sum"] = "advantages"
    """Bring both advantages to standard deviation 1 before they are added, or only their sum."""
    mimic: MimicConfig = MimicConfig()

    @model_validator(mode="after")
    def _enough_references(self) -> ImapConfig:
        if self.references <= self.neighbours:
            raise ValueError(
                f"references ({self.references}) must be more than neighbours ({self.neighbours})"
            )
        return self
