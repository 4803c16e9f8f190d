"""What a retraining depends on: pure data."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from apil_core.api.config import ActionMode, CheckpointConfig, EvaluationConfig, PPOConfig, Section

Critic = Literal["auto", "stored", "new"]


class RetrainEvaluation(EvaluationConfig):
    """Scores against each opponent on its own."""

    before: bool = True
    """Also score the victim as it was, so that there is something to compare with."""


class RetrainConfig(Section):
    """Everything that decides a hardened victim. Equal settings on one machine give equal weights."""

    kind: Literal["retraining"] = "retraining"
    """Tells this file from a run's."""
    version: Literal[1] = 1
    """Version of this schema."""
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
    sparse_weight: float | None = None
    """Weight of the outcome, the only reward there is; null takes the game's default."""
    normalize_reward: bool = True
    """Divide by the running standard deviation of the discounted return and clip to ±10."""
    steps: Annotated[int, Field(gt=0)] = 10_000_000
    """Environment steps of training, rounded up to whole rollouts."""
    num_envs: Annotated[int, Field(gt=0, le=2**20)] = 128
    """Games stepped together."""
    threads: Annotated[int, Field(ge=0)] = 0
    """Physics threads; 0: all CPUs. Never changes results."""
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 0
    """Seed of everything random."""
    device: str = "cpu"
    """Where the networks live: cpu, cuda or cuda:N."""
    ppo: PPOConfig = PPOConfig()
    evaluation: RetrainEvaluation = RetrainEvaluation()
    checkpoint: CheckpointConfig = CheckpointConfig()
    game: dict[str, Any] = Field(default_factory=dict)
    """Options of the game, checked by the game's own model."""
    recorders: tuple[str, ...] = ("jsonl", "tensorboard")
    """Where metrics go."""
    plugins: tuple[str, ...] = ()
    """One-file plugins (paths) to load before anything else."""
