"""The configuration of a retraining: a run's settings, and its own."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from apil_core.api.config import ActionMode, EvaluationConfig, RewardConfig, RunConfig

Critic = Literal["auto", "stored", "new"]

VERSION: Literal[2] = 2
"""Version of the schema and of the checkpoints; version 1 had another learner; its runs cannot be resumed."""

MIXED = "mixed"
"""Label of games in which opponents change from step to step."""

NOT_ITS_OWN = (
    *("method", "victim_actions", "options", "observers", "init_from", "init_steps"),
    *("reward.dense_weight", "reward.anneal_fraction", "reward.anneal_budget", "ppo.critic_observes"),
    "evaluation.stop_when",
)
"""Settings of a run that a retraining has no use for: they stay as they are by default."""


OF_THE_VICTIM = ("init_std", "action_unit", "observation_clip")
"""PPO's settings that the victim's network brings along; stored retrainings may have others, to no effect."""


class RetrainEvaluation(EvaluationConfig):
    """Scores against each opponent on its own."""

    before: bool = True
    """Also score the victim as it was, so that there is something to compare with."""


class RetrainConfig(RunConfig):
    """All settings of a retraining. Equal settings on one machine give equal weights."""

    kind: Literal["retraining"] = "retraining"
    """Distinguishes this file from a run's."""
    version: Literal[1, 2] = VERSION
    """Version of this schema."""
    method: str = "retraining"
    """Stands where a run has its attack method."""
    adversaries: tuple[str, ...]
    """Runs (or policies) that attack the victim; they share `adversary_share` equally."""
    adversary_sha256: tuple[str, ...] = ()
    """SHA-256 of their weights when the retraining began (filled in); resuming refuses others."""
    labels: tuple[str, ...] = ()
    """Short names of the opponents, the baseline last (filled in)."""
    env: str
    """Game they were trained on."""
    victim: str
    """Policy to harden: zoo:…, embedded:…, retrained:DIR, a student's safetensors:FILE, a plain run:DIR."""
    victim_sha256: str = ""
    """SHA-256 of its weights when the retraining began (filled in); resuming refuses others."""
    victim_side: Literal[0, 1]
    """Its seat."""
    baseline: str = "auto"
    """Adversary it already knows; auto: the game's own."""
    baseline_sha256: str = ""
    """SHA-256 of its weights when the retraining began (filled in)."""
    trust: bool = False
    """Allow players whose loading runs code, e.g. python:...; counts in Python only, not in a file."""
    adversary_share: Annotated[float, Field(ge=0, le=1)] = 0.5
    """Share of games (or steps) played against the adversaries; the rest is the baseline's."""
    mix: Literal["per_episode", "per_step"] = "per_episode"
    """Draw the opponent for each game, or anew for each step of it."""
    adversary_actions: ActionMode = "sample"
    """Draw the opponents' actions in training, or take the mode."""
    critic: Critic = "auto"
    """Value network: the victim's own, denormalised (stored), or a new one; auto: stored if it has one."""
    critic_warmup: Annotated[int, Field(ge=0)] | None = None
    """First iterations that train the critic alone; null: 10 for a new one, else 1."""
    freeze: Literal["none", "value"] = "none"
    """Keep the stored value network as it is, or nothing."""
    steps: Annotated[int, Field(gt=0)] = 10_000_000
    """Environment steps of training, rounded up to whole rollouts."""
    reward: RewardConfig = RewardConfig()
    """The outcome is the only reward there is: its weight, and whether returns are normalised."""
    evaluation: RetrainEvaluation = RetrainEvaluation()

    @property
    def opponents(self) -> dict[str, str]:
        """Policy names by label, the baseline's last if there is one."""
        names = [*self.adversaries, *([self.baseline] if self.baseline else [])]
        return dict(zip(self.labels, names, strict=True))

    @property
    def shares(self) -> dict[str, float]:
        """Share of play of each opponent by label; the adversaries split theirs equally."""
        many = len(self.adversaries)
        parts = [self.adversary_share / many] * many + [1 - self.adversary_share]
        return dict(zip(self.labels, parts, strict=False))

    @model_validator(mode="before")
    @classmethod
    def _as_version_2_has_it(cls, data: Any) -> Any:
        """Convert version 1, which kept the two settings of the reward at the top level."""
        old = {"sparse_weight": "sparse_weight", "normalize_reward": "normalize"}
        if not isinstance(data, dict) or not old.keys() & data.keys():
            return data
        moved = {new: data[key] for key, new in old.items() if key in data}
        rest = {key: value for key, value in data.items() if key not in old}
        return {**rest, "reward": {**(rest.get("reward") or {}), **moved}}

    @model_validator(mode="after")
    def _only_its_own(self) -> RetrainConfig:
        for name in NOT_ITS_OWN:
            section, _, key = name.rpartition(".")
            model = getattr(self, section) if section else self
            field = type(model).model_fields[key]
            if getattr(model, key) != field.get_default(call_default_factory=True):
                raise ValueError(f"{name} is no setting of a retraining")
        return self
