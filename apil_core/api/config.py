"""The configuration of a run: pure data (:mod:`apil_core.config.resolve` reads it from files)."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationInfo,
    field_validator,
    model_validator,
)

from apil_core.common.annotations import alternatives
from apil_core.common.numbers import whole_number

if TYPE_CHECKING:
    from apil_core.api.specs import MethodSpec

SCHEMA_VERSION = 1
"""Raised when a config of this version could be misread by older code."""

ActionMode = Literal["sample", "mode"]
BlindMode = Literal["zeros", "initial"]


@dataclass(frozen=True)
class Absent:
    """Meaning of a key's absence from a stored config that is older than the key; see :func:`absent`."""

    value: Any


def absent(value: Any) -> Absent:
    """Annotate a key added to a released model whose default differs from the earlier behaviour.

    ``key: Annotated[int | None, absent(None)] = 4``: new configs get 4, a stored one without the key means
    null. Absent keys without this mark mean their default. Sections inside sections are searched,
    sections in lists and dicts are not.
    """
    return Absent(value)


def _path_text(value: Any) -> Any:
    """Paths as text; nothing else becomes one."""
    return str(value) if isinstance(value, Path) else value


class Section(BaseModel):
    """Base of every config model: unknown keys are errors, values are checked on assignment."""

    model_config = ConfigDict(
        extra="forbid",
        validate_assignment=True,
        use_attribute_docstrings=True,
        ser_json_inf_nan="constants",
    )

    @field_validator("*", mode="before")
    @classmethod
    def _whole_number(cls, value: Any, info: ValidationInfo) -> Any:
        """300k and 35M as numbers, for fields that are whole numbers."""
        if isinstance(value, str):
            kinds = alternatives(cls.model_fields[info.field_name or ""].annotation)
            with suppress(ValueError):  # the field's own validation says what is wrong
                return whole_number(value) if {int, str}.intersection(kinds) == {int} else value
        return value


Width = Annotated[int, Field(gt=0, le=2**16)]
"""Units of a layer."""


class RewardConfig(Section):
    """Training reward ``c·w_dense·dense + (1−c)·w_sparse·sparse`` (docs/methods.md §1); null: the game's."""

    dense_weight: float | None = None
    """Weight of movement shaping; null takes the game's default."""
    sparse_weight: float | None = None
    """Weight of the outcome; null takes the game's default."""
    anneal_fraction: Annotated[float, Field(ge=0, le=1)] | None = None
    """Share of training over which c falls from 1 to 0 (0: sparse only); null takes the game's default."""
    anneal_budget: Annotated[int, Field(gt=0)] | None = None
    """Environment steps that anneal_fraction is a share of; null: the run's budget."""
    normalize: bool = True
    """Divide by the running standard deviation of the discounted return and clip to ±10."""


class PPOConfig(Section):
    """The learner every method shares (docs/methods.md §3)."""

    num_steps: Annotated[int, Field(gt=0, le=2**20)] = 128
    """Steps per game in one rollout; the batch is num_envs × num_steps (paper: 8 × 2048)."""
    epochs: Annotated[int, Field(gt=0)] = 4
    """Passes over each rollout."""
    minibatches: Annotated[int, Field(gt=0)] = 4
    """Parts of the rollout per pass."""
    max_kl: Annotated[float, Field(gt=0)] | None = None
    """Early stopping of an update: no further pass above this mean KL, in nats; null: never."""
    learning_rate: Annotated[float, Field(gt=0)] = 3e-4
    """Adam's step size at the start."""
    lr_schedule: Literal["constant", "linear"] = "constant"
    """Constant, or linear to zero over the run's steps."""
    optimizer: Literal["adam", "adamw"] = "adam"
    """Optimiser of actor and critic (epsilon 1e-5)."""
    gamma: Annotated[float, Field(gt=0, le=1)] = 0.99
    """Discount per step."""
    lam: Annotated[float, Field(ge=0, le=1)] = 0.95
    """λ of generalised advantage estimation."""
    clip: Annotated[float, Field(gt=0)] = 0.2
    """Clip of the probability ratio, and of the value update if that is clipped."""
    clip_value: bool = True
    """Clip how far an iteration may move a value (as published); it binds where returns are large."""
    value_coefficient: Annotated[float, Field(ge=0)] = 0.5
    """Weight of ½·(V − R)² in the loss, the convention of the published code."""
    entropy_coefficient: Annotated[float, Field(ge=0)] = 0.0
    """Weight of the entropy bonus."""
    max_grad_norm: Annotated[float, Field(gt=0)] = 0.5
    """Gradient clip, for actor and critic separately."""
    hidden: Annotated[tuple[Width, ...], Field(min_length=1)] = (64, 64)
    """Hidden tanh layers of actor and critic."""
    action_unit: Literal["game", "limit"] = "game"
    """Unit of the policy's mean and spread: the game's own, or a motor's limit (0.4 in humanoids)."""
    init_std: Annotated[float, Field(gt=0)] = 1.0
    """Standard deviation of the untrained policy's actions, in that unit."""
    critic_observes: Literal["own", "both"] = "own"
    """Input of the critics: the adversary's observation, or also the victim's and the time left."""
    noise: Literal["white", "ar1", "coloured"] = "white"
    """Exploration: each step's draw by itself, or correlated over a game; evaluations draw white."""
    noise_correlation: Annotated[float, Field(ge=0, lt=1)] = 0.8
    """ar1: correlation ρ of successive draws."""
    noise_colour: Annotated[float, Field(ge=0, le=2)] = 0.5
    """coloured: β of the power spectrum 1/f^β."""
    observation_clip: Annotated[float, Field(gt=0)] = 10.0
    """Clip of the normalised observation."""


class StopConfig(Section):
    """Early stopping, before the budget is used up; checked after each evaluation during training."""

    win_rate_above: Annotated[float, Field(ge=0, lt=1)] | None = None
    """Stop when the whole 95 % interval of the win rate is above this; null: never."""
    no_gain_in: Annotated[int, Field(gt=0)] | None = None
    """Stop after this many evaluations without a higher win rate than an earlier one; null: never."""


class EvaluationConfig(Section):
    """Scoring during and after training."""

    episodes: Annotated[int, Field(ge=0)] = 1000
    """Games of the final evaluation; 0: none. 1000 games give ± 3 points at 50 %."""
    every_steps: Annotated[int, Field(ge=0)] = 0
    """Environment steps between evaluations during training; 0: none. The best's checkpoint is kept."""
    periodic_episodes: Annotated[int, Field(gt=0)] = 200
    """Games of each evaluation during training, of other seeds than the final one's."""
    stop_when: StopConfig = StopConfig()
    adversary_actions: ActionMode = "sample"
    """Draw the adversary's evaluation actions, or take the mode."""
    victim_actions: ActionMode = "sample"
    """Draw the victim's evaluation actions, or take the mode."""

    @model_validator(mode="after")
    def _stop_needs_evaluations(self) -> EvaluationConfig:
        if self.stop_when != StopConfig() and not self.every_steps:
            raise ValueError("stop_when needs evaluations during training: set every_steps")
        return self


class CheckpointConfig(Section):
    """Checkpoints, from which a run resumes."""

    every_iterations: Annotated[int, Field(gt=0)] = 10
    """PPO iterations between checkpoints (one is always written at the end and on Ctrl-C)."""
    keep: Annotated[int, Field(gt=0)] = 2
    """Number of newest checkpoints kept on disk."""


class RunConfig(Section):
    """All settings that determine a run's outcome. Equal configs on one machine give equal weights."""

    version: int = SCHEMA_VERSION
    """Version of this schema."""
    method: str = "e_apil"
    """Attack method; `apil methods` lists them."""
    env: str = "kick-and-defend"
    """Game; `apil games` lists them."""
    victim: str = "auto"
    """Policy under attack, e.g. zoo:kick-and-defend/kicker/v1; auto: the game's default."""
    victim_sha256: str = ""
    """SHA-256 of the victim's weights when the run began (filled in by the run); resuming refuses others."""
    trust: bool = False
    """Allow a victim whose loading runs code, e.g. python:...; only set from Python: ignored in a file."""
    victim_side: Literal[0, 1] | None = None
    """Index of the attacked side; null: the game's default."""
    victim_actions: ActionMode = "sample"
    """Draw the victim's actions during training, or take the mode."""
    steps: Annotated[int, Field(gt=0)] = 35_000_000
    """Environment steps of training (the paper's budget by default), rounded up to whole rollouts."""
    num_envs: Annotated[int, Field(gt=0, le=2**20)] = 128
    """Games stepped together."""
    threads: Annotated[int, Field(ge=0)] = 0
    """Threads of physics, and of the update (two at most); 0: all CPUs. Never changes results."""
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 0
    """Seed of all random numbers."""
    device: str = "cpu"
    """Device of the networks: cpu, cuda or cuda:N (physics is always on the CPU)."""
    reward: RewardConfig = RewardConfig()
    ppo: PPOConfig = PPOConfig()
    evaluation: EvaluationConfig = EvaluationConfig()
    checkpoint: CheckpointConfig = CheckpointConfig()
    game: dict[str, Any] = {}
    """Options of the game, checked by the game's own model."""
    options: dict[str, dict[str, Any]] = {}
    """Options per method and observer, e.g. options.apil.prediction; checked by each plugin's own model."""
    recorders: tuple[str, ...] = ("jsonl", "tensorboard")
    """Recorders of metrics."""
    log_rows: Annotated[int, Field(gt=0)] = 10_000
    """Rows of metrics at most, evaluations aside: a run of more iterations merges several into each row."""
    observers: tuple[str, ...] = ()
    """Observers, and plugins with their own run hooks, that are switched on, in this order."""
    plugins: tuple[str, ...] = ()
    """One-file plugins (paths) to load before anything else."""
    init_from: Annotated[str, BeforeValidator(_path_text)] | None = None
    """Run directory to initialise from, or policy (zoo:…, run:…) to clone first."""
    init_steps: Annotated[int, Field(gt=0)] = 200_000
    """Environment steps of the budget in which a policy named by init_from is cloned and its value learnt."""

    @classmethod
    def load(
        cls,
        source: Path | str | None = None,
        /,
        *,
        presets: Sequence[str] = (),
        method: str | type | MethodSpec = "",
        **settings: Any,
    ) -> RunConfig:
        """Read and check a configuration, every option of its method and game filled in.

        Args:
            source: a preset's name, a YAML file, or a run directory to copy the settings of.
            presets: names of presets below it, the later ones on top.
            method: name, or a class of this session (see :func:`apil_core.define`).
            settings: on top, by key: ``steps="1M"``, ``ppo={"gamma": 0.995}``, or with dots in
                ``**{"ppo.gamma": 0.995}``; ``physics`` is short for ``game.physics``. A policy is its name
                or the object.

        Raises:
            ApilError: one line per mistake, with the nearest known name.
        """
        from apil_core import _load_config  # a layer above: this class is data only

        return _load_config(source, presets, {**settings, **({"method": method} if method else {})})

    @property
    def rollout_steps(self) -> int:
        """Environment steps of one rollout of all games, PPO's batch; side games are not in it."""
        return self.num_envs * self.ppo.num_steps

    @model_validator(mode="after")
    def _batch_divides(self) -> RunConfig:
        if self.rollout_steps < 2 * self.ppo.minibatches:
            raise ValueError(
                f"num_envs × ppo.num_steps ({self.rollout_steps}) must hold at least two samples for each of "
                f"ppo.minibatches ({self.ppo.minibatches}): advantages are normalised per minibatch"
            )
        return self
