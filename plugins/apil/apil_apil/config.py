"""APIL's options: every point where the paper's text and the published code differ (docs/methods.md §3)."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from apil_core import Section, absent


class ImitatorConfig(Section):
    """The imitator π̃: a Gaussian policy with its own critics."""

    objective: Literal["gail", "likelihood", "both"] = "gail"
    """Look like the victim to D, give the victim's actions a high likelihood, or both."""
    credit: Annotated[Literal["step", "return"] | None, absent("return")] = None
    """D's reward for ã_t: its own step's, or the return from there; null: step where rollouts are shared."""
    update: Literal["trpo", "ppo"] = "ppo"
    """PPO (the paper's brief algorithm, and the published code) or TRPO (its detailed one)."""
    hidden: Annotated[tuple[Annotated[int, Field(gt=0)], ...], Field(min_length=1)] = (64, 64)
    """Hidden tanh layers of policy and critic."""
    init_std: Annotated[float, Field(gt=0)] = 1.0
    """Standard deviation of the untrained imitator."""
    gamma: Annotated[float, Field(gt=0, le=1)] = 0.99
    """Discount of D's reward (credit: return)."""
    lam: Annotated[float, Field(ge=0, le=1)] = 0.95
    """λ of its advantage estimate (credit: return)."""
    likelihood_weight: Annotated[float, Field(gt=0)] = 1.0
    """Objective both: weight of the log-likelihood when training begins."""
    likelihood_floor: Annotated[float, Field(ge=0)] = 0.1
    """Objective both: what that weight falls to."""
    likelihood_half_life: Annotated[float, Field(gt=0)] = 500_000.0
    """Objective both: environment steps in which that weight halves."""
    entropy_coefficient: Annotated[float, Field(ge=0)] = 0.0
    """λ of the entropy bonus (a bonus: the paper's minus sign is a slip)."""
    kl: Annotated[float, Field(gt=0)] = 0.01
    """TRPO: trust region, mean KL in nats."""
    cg_steps: Annotated[int, Field(gt=0)] = 10
    """TRPO: conjugate-gradient steps."""
    damping: Annotated[float, Field(ge=0)] = 0.1
    """TRPO: added to the Fisher matrix's diagonal."""
    backtracks: Annotated[int, Field(gt=0)] = 10
    """TRPO: halvings of the step before giving up."""
    fisher_fraction: Annotated[float, Field(gt=0, le=1)] = 0.2
    """TRPO: share of the rollout the Fisher matrix is estimated on."""
    value_epochs: Annotated[int, Field(gt=0)] = 1
    """Passes of the critic per iteration."""
    value_learning_rate: Annotated[float, Field(gt=0)] = 1e-3
    """Adam's step size of the critic."""
    learning_rate: Annotated[float, Field(gt=0)] = 6e-4
    """PPO: Adam's step size of the policy."""
    clip: Annotated[float, Field(gt=0)] = 0.2
    """PPO: clip of the probability ratio."""
    epochs: Annotated[int, Field(gt=0)] = 2
    """PPO: passes per iteration."""
    minibatches: Annotated[int, Field(gt=0)] = 32
    """Parts of the rollout per pass (policy under PPO, critic always)."""
    max_grad_norm: Annotated[float, Field(gt=0)] = 0.5
    """Gradient clip."""


class DiscriminatorConfig(Section):
    """The discriminator D(s, a): probability that the victim did a in s."""

    hidden: Annotated[tuple[Annotated[int, Field(gt=0)], ...], Field(min_length=1)] = (128, 128)
    """Hidden tanh layers."""
    learning_rate: Annotated[float, Field(gt=0)] = 1e-3
    """Adam's step size; slower ones were seen to let D saturate behind its tanh and never recover."""
    epochs: Annotated[Annotated[int, Field(gt=0)] | None, absent(None)] = 2
    """Passes over each rollout; null: as many as PPO's."""
    minibatches: Annotated[Annotated[int, Field(gt=0)] | None, absent(None)] = 32
    """Parts of the rollout per pass; null: as many as PPO's."""
    gradient_penalty: Annotated[Annotated[float, Field(ge=0)], absent(0.0)] = 0.3
    """Weight of the logit's squared gradient by the action, taken between the victim's and the imitator's."""
    logit_bound: Literal["tanh", "none"] = "tanh"
    """tanh: the logit lies in [-1, 1], D in [.269, .731], as the theorem assumes; none: unbounded."""
    state: Literal["current", "next"] = "current"
    """State scored with a_t: s_t (the paper) or s_{t+1} (the published code)."""


class ApilConfig(Section):
    """APIL's options; defaults follow the paper's text."""

    prediction: Literal["imitator", "oracle", "noise", "none"] = "imitator"
    """Source of ã: the imitator's prediction, the victim's true action, noise of its scale, or none."""
    prediction_actions: Literal["sampled", "mode"] = "sampled"
    """sampled: ã is drawn in training and the mode in evaluation; mode: the mode in both."""
    observes: Literal["victim", "adversary", "both"] = "victim"
    """Observation that the imitator and D read."""
    share_victim_observation: bool = False
    """Also give the adversary the victim's observation (published code; more than ADRL and APL see)."""
    rollouts: Literal["shared", "own"] = "shared"
    """shared: learn from the games in which the victim acts; own: further games, the imitator acting."""
    reward: Literal["log_d", "neg_log_1md", "logit"] = "log_d"
    """The imitator's reward: log D (the paper), −log(1 − D) (the published code), or logit, their sum."""
    reward_time: Literal["after_update", "collected"] = "after_update"
    """Score the rollout with D after its update, or with D as it was during collection."""
    imitator: ImitatorConfig = ImitatorConfig()
    discriminator: DiscriminatorConfig = DiscriminatorConfig()

    @model_validator(mode="after")
    def _own_rollouts_need_an_imitator(self) -> ApilConfig:
        if self.rollouts == "own" and self.prediction != "imitator":
            raise ValueError("rollouts: own needs prediction: imitator")
        return self
