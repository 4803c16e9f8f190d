"""The configuration of a distillation, and how flags and ``--set`` make it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal

from pydantic import Field

from apil_core.api.config import Section
from apil_core.config.game import game_model, profile_problems
from apil_core.config.layers import flag_layer, merge, set_layer
from apil_core.config.problems import raise_problems, validated
from apil_core.plugins.discovery import PluginRegistry
from apil_core.plugins.registry import default_plugins


class DistillConfig(Section):
    """All settings of a distillation. Equal settings on one machine give equal weights."""

    env: str
    """Game; `apil games` lists them."""
    role: str
    """Side the student is to play, e.g. kicker."""
    teacher: str = "auto"
    """Policy to imitate; auto: the agent the game names for this side."""
    opponent: str = "auto"
    """Opponent in training and in the report; auto: the agent the game names for the other side."""
    trust: bool = False
    """Allow players whose loading runs code, e.g. python:...; counts in Python only, not in a file."""
    network: Literal["auto", "mlp", "lstm"] = "auto"
    """Student's network; auto: lstm for a recurrent teacher, else mlp."""
    width: Annotated[int, Field(gt=0)] = 128
    """Units of the LSTM."""
    embed: Annotated[int, Field(ge=0)] = 128
    """ReLU units before the LSTM; 0: none."""
    hidden: tuple[Annotated[int, Field(gt=0)], ...] | None = None
    """tanh layers before the output; null: none above an LSTM, else 64 and 64."""
    steps: Annotated[int, Field(gt=0)] = 500_000
    """Game steps to play and label, rounded up to whole blocks, at least two. In the first block the teacher
    acts, afterwards mostly the student (DAgger)."""
    block_steps: Annotated[int, Field(gt=0)] | None = None
    """Steps of each game per block; null: the game's step limit, at most 512. Each block begins new games."""
    num_envs: Annotated[int, Field(gt=0, le=2**20)] = 128
    """Games stepped together."""
    passes_per_block: Annotated[int, Field(gt=0)] = 4
    """Passes over each new block, each after one over an earlier block drawn at random."""
    final_passes: Annotated[int, Field(ge=0)] = 25
    """Passes over all blocks at the end, while the learning rate falls to zero."""
    learning_rate: Annotated[float, Field(gt=0)] | None = None
    """Adam's step size before the final passes; null: 2e-3 with an LSTM, else 1e-2."""
    minibatch: Annotated[int, Field(gt=0)] = 512
    """Steps behind each gradient."""
    gradient_length: Annotated[int, Field(gt=0)] = 8
    """Steps of backpropagation through time."""
    observation_clip: Annotated[float, Field(gt=0)] = 5.0
    """Clip of the standardised observation."""
    both_seats: bool | None = None
    """Play both sides in turn; null: where the game's sides can be exchanged."""
    episodes: Annotated[int, Field(ge=0)] = 1000
    """Games of the final scores of student and of teacher; 0: none."""
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 0
    """Seed of everything random."""
    threads: Annotated[int, Field(ge=0)] = 0
    """Physics threads; 0: all CPUs. Never changes results."""
    device: str = "cpu"
    """Where the networks live: cpu, cuda or cuda:N."""
    game: dict[str, Any] = Field(default_factory=dict)
    """Options of the game, checked by the game's own model."""
    practice: dict[str, Any] = Field(default_factory=dict)
    """Options of the game that differ in three of four blocks, e.g. cheaper physics; never in a score."""


def settings(
    flags: Mapping[str, Any], sets: Sequence[str] = (), plugins: PluginRegistry | None = None
) -> DistillConfig:
    """Merge defaults, flags and ``KEY=VALUE`` texts, later ones over earlier ones.

    Args:
        flags: values by setting; ``game.physics`` for the profile.
        sets: ``KEY=VALUE`` texts.
        plugins: registry with the game; default: the installed ones.

    Raises:
        ConfigError: one line per mistake.
    """
    data, origins = merge({}, [flag_layer(flags), *map(set_layer, sets)])
    config = validated(DistillConfig, data, origins)
    model = game_model(config.env, plugins or default_plugins())
    raise_problems(profile_problems(data, model, config.env), origins)
    return config
