"""The stages of a distillation: play a block, train on it and on earlier ones; final passes at the end."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import torch
from torch import Tensor

from apil_core.common.seeds import stream_generator
from apil_core.policies.network import NetworkShape, Standardizer
from apil_core.runs.distillation.collector import Collector, Roles, Sample
from apil_core.runs.distillation.config import DistillConfig
from apil_core.runs.distillation.learner import Block, StudentLearner
from apil_core.training.normalize import RunningMoments

_TRUE_BLOCKS = 4
"""Period of the blocks, from the first, that are played by the game's own options instead of ``practice``."""

_LEAST_STD = 0.1
"""Lower bound of the standard deviation, so that nearly constant channels are not amplified."""


@dataclass
class Entry:
    """One line of the log: the result of a stage.

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
class Course:
    """State of a distillation between two stages.

    A stage is a block with its passes, or one final pass over all blocks. A stage is determined by
    the settings, its number and the state before it, so a distillation resumes bit for bit.
    """

    config: DistillConfig
    shape: NetworkShape
    collector: Collector
    practice: Collector
    learner: StudentLearner
    log_std: Tensor
    sides: tuple[int, ...]
    block_steps: int
    standardize: Standardizer | None = None
    log: list[Entry] = field(default_factory=list)
    blocks: list[Block] = field(default_factory=list)

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
        """Run the next stage."""
        if self.done < self.rounds:
            error, fresh = self._round()
            entry = Entry(self.done + 1, self.steps, error, fresh)
        else:
            entry = Entry(self.done + 1, self.steps, self._final_pass())
        self.log.append(entry)
        return entry

    def _round(self) -> tuple[float, float | None]:
        """Play a block and train on it and on other blocks."""
        number = len(self.blocks)
        block = Block.empty(self.block_steps, self.config.num_envs, self.shape, self.log_std.device)
        self.learner.begin(self.config.num_envs)
        fresh = None
        if number:
            fresh = self._play(block, number)
        else:
            self._first_block(block)
        self.blocks.append(block)
        generator = self._generator(f"replay {number}")
        error = 0.0
        for _ in range(self.config.passes_per_block):
            if number:
                earlier = int(torch.randint(number, (), generator=generator))
                self.learner.train(self.blocks[earlier], generator)
            error = self.learner.train(block, generator)
        return error, fresh

    def _first_block(self, block: Block) -> None:
        """Play the teacher's block; its observations standardise all that follow, these included."""
        moments = RunningMoments(self.shape.observation_size).to(self.log_std.device)
        sigma = self.log_std.exp()

        def take(sample: Sample) -> None:
            moments.update(sample.observation)
            block.record(sample.observation, sample.label / sigma, sample.done)

        self.collector.play("block 0", self.sides[0], self.block_steps, self._roles(True), None, take)
        std = moments.var.sqrt().clamp(min=_LEAST_STD)
        self.standardize = Standardizer(moments.mean.float(), std.float(), self.config.observation_clip)
        for t in range(self.block_steps):
            block.observation[t] = self.standardize(block.observation[t])

    def _play(self, block: Block, number: int) -> float:
        """Play a block in which the student acts; return its error there."""
        learner, sigma, standardize = self.learner, self.log_std.exp(), self.standardize
        assert standardize is not None, "the first block sets it"
        roles = self._roles(False)
        errors: list[Tensor] = []
        seen = torch.empty(0)

        def act(observation: Tensor, label: Tensor) -> Tensor:
            nonlocal seen
            seen = standardize(observation)
            mean = learner.act(seen)
            errors.append((mean - label / sigma)[~roles.teacher_acts].square().mean())
            return mean * sigma

        def take(sample: Sample) -> None:
            block.record(seen, sample.label / sigma, sample.done)
            learner.ended(sample.done)

        # shifted by one at every block of true physics, so that each seat plays some of it
        side = self.sides[(number + number // _TRUE_BLOCKS) % len(self.sides)]
        games = self.practice if number % _TRUE_BLOCKS else self.collector
        games.play(f"block {number}", side, self.block_steps, roles, act, take)
        return float(torch.stack(errors).mean())

    def _roles(self, teacher_only: bool) -> Roles:
        return Roles.of(self.config.num_envs, self.log_std.device, teacher_only=teacher_only)

    def _final_pass(self) -> float:
        """Train over all blocks, at a rate that falls linearly to zero over all final passes."""
        number, rate = self.done - self.rounds, self.config.learning_rate
        assert rate is not None, "the settings are complete"
        generator = self._generator(f"final {number}")
        order = torch.randperm(len(self.blocks), generator=generator).tolist()
        errors = []
        for i, index in enumerate(order):
            left = 1 - (number + i / len(order)) / self.config.final_passes
            self.learner.set_learning_rate(rate * left)
            errors.append(self.learner.train(self.blocks[index], generator))
        return math.fsum(errors) / len(errors)

    def _generator(self, stream: str) -> torch.Generator:
        return stream_generator(self.config.seed, f"distillation {stream}", torch.device("cpu"))

    def weights(self) -> dict[str, Tensor]:
        """The student's present weights, as stored in its file."""
        assert self.standardize is not None, "there is a student after the first stage"
        return self.learner.weights(self.standardize.mean, self.standardize.std, self.log_std)
