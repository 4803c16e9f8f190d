"""The course of a distillation: play a block, train on it and on earlier ones, and refine at the end."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
from torch import Tensor

from apil_core.distillation.collector import Cast, Collector, Sample
from apil_core.distillation.learner import StudentLearner, block_tensors
from apil_core.distillation.options import DistillConfig
from apil_core.normalize import RunningMoments
from apil_core.seeds import stream_seed
from apil_core.victims.student_policy import StudentShape

_TRUE_BLOCKS = 4
"""Every so many blocks, from the first, are played by the game's own options instead of ``practice``."""

_LEAST_STD = 0.1
"""Channels that hardly move are not blown up."""


@dataclass
class Entry:
    """One line of the log: what a stage gave.

    Attributes:
        stage: number of stages done.
        steps: labelled game steps so far.
        error: mean squared error before each gradient of the newest pass, in units of the teacher's σ².
        fresh_error: of the student that acted in this block, on its own states; ``None`` in final passes.
    """

    stage: int
    steps: int
    error: float
    fresh_error: float | None = None


@dataclass
class Standard:
    """Standardisation of observations: (o,) each, from the first block, and fixed from then on."""

    mean: Tensor
    std: Tensor
    clip: float

    def __call__(self, observation: Tensor) -> Tensor:
        """(n, o) → (n, o)."""
        return ((observation - self.mean) / self.std).clamp_(-self.clip, self.clip)


@dataclass
class Course:
    """State of a distillation between two stages.

    A stage is a block with its passes, or one final pass over all blocks. What a stage does follows from
    the settings, its number and the state before it, so a distillation goes on bit for bit.
    """

    config: DistillConfig
    shape: StudentShape
    collector: Collector
    practice: Collector
    learner: StudentLearner
    log_std: Tensor
    sides: tuple[int, ...]
    block_steps: int
    standard: Standard | None = None
    log: list[Entry] = field(default_factory=list)
    blocks: list[Any] = field(default_factory=list)

    @property
    def rounds(self) -> int:
        """Number of blocks to play."""
        return max(math.ceil(self.config.steps / (self.block_steps * self.config.num_envs)), 2)

    @property
    def stages(self) -> int:
        """Number of all stages."""
        return self.rounds + self.config.final_passes

    @property
    def done(self) -> int:
        """Number of stages done."""
        return len(self.log)

    @property
    def steps(self) -> int:
        """Labelled game steps so far."""
        return len(self.blocks) * self.block_steps * self.config.num_envs

    def advance(self) -> Entry:
        """Do the next stage."""
        if self.done < self.rounds:
            error, fresh = self._round()
            entry = Entry(self.done + 1, self.steps, error, fresh)
        else:
            entry = Entry(self.done + 1, self.steps, self._final_pass())
        self.log.append(entry)
        return entry

    def _round(self) -> tuple[float, float | None]:
        """Play a block and train on it, and on others."""
        number = len(self.blocks)
        block = self.learner.new_block()
        self.learner.begin(block)
        fresh = self._first_block(block) if number == 0 else self._play(block, number)
        self.blocks.append(block)
        rng = self._rng(f"replay {number}")
        error = 0.0
        for _ in range(self.config.passes_per_block):
            if number:
                self.learner.train(self.blocks[rng.integers(number)])
            error = self.learner.train(block)
        return error, fresh

    def _first_block(self, block: Any) -> None:
        """The teacher alone; its observations standardise all that follow, these included."""
        learner, moments = self.learner, RunningMoments(self.shape.observation_size).to(self.log_std.device)

        def take(sample: Sample) -> None:
            moments.update(sample.observation)
            learner.act(sample.observation, sample.label / self.log_std.exp())
            learner.record(sample.done)

        self.collector.play("block 0", self.sides[0], self.block_steps, self._cast(True), None, take)
        std = moments.var.sqrt().clamp(min=_LEAST_STD)
        self.standard = Standard(moments.mean.float(), std.float(), self.config.observation_clip)
        observations = block_tensors(block)["observation"]
        for t in range(self.block_steps):
            observations[t] = self.standard(observations[t])

    def _play(self, block: Any, number: int) -> float:
        """A block in which the student acts; gives its error there."""
        learner, sigma, standard = self.learner, self.log_std.exp(), self.standard
        assert standard is not None, "the first block sets it"
        cast = self._cast(False)
        errors: list[Tensor] = []

        def act(observation: Tensor, label: Tensor) -> Tensor:
            mean = learner.act(standard(observation), label / sigma)
            errors.append((mean - label / sigma)[~cast.teacher_acts].square().mean())
            return mean * sigma

        side = self.sides[number % len(self.sides)]
        games = self.practice if number % _TRUE_BLOCKS else self.collector
        games.play(
            f"block {number}", side, self.block_steps, cast, act, lambda sample: learner.record(sample.done)
        )
        return float(torch.stack(errors).mean())

    def _cast(self, teacher_only: bool) -> Cast:
        return Cast.of(self.config.num_envs, self.log_std.device, teacher_only=teacher_only)

    def _final_pass(self) -> float:
        """Over all blocks, at a rate that falls linearly to zero over all final passes."""
        number = self.done - self.rounds
        order = self._rng(f"final {number}").permutation(len(self.blocks))
        errors = []
        for i, index in enumerate(order):
            left = 1 - (number + i / len(order)) / self.config.final_passes
            self.learner.set_learning_rate(self.config.learning_rate * left)
            errors.append(self.learner.train(self.blocks[index]))
        return float(np.mean(errors))

    def _rng(self, stream: str) -> np.random.Generator:
        return np.random.default_rng(stream_seed(self.config.seed, f"distillation {stream}"))

    def weights(self) -> dict[str, Tensor]:
        """The student as it stands, as its file has it."""
        assert self.standard is not None, "there is a student after the first stage"
        return self.learner.weights(self.standard.mean, self.standard.std, self.log_std)


Tell = Callable[[Entry, int], None]
"""Called after each stage with its entry and the number of all stages."""
