"""The stages of a distillation: play a block, train on it and on earlier ones; final passes at the end."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import torch
from torch import Tensor

from apil_core.api.game import Game
from apil_core.api.policy import Policy, PolicyInfo
from apil_core.common.errors import VictimError
from apil_core.common.seeds import stream_generator
from apil_core.policies.frozen_policy import FrozenPolicy
from apil_core.policies.network import NetworkShape, Standardizer
from apil_core.runs.distillation.collector import Collector, Roles
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


class DistillTrainer:
    """A distillation in memory.

    A stage is a block with its passes, or one final pass over all blocks. A stage is determined by
    the settings, its number and the state before it, so a distillation resumes bit for bit.

    Args:
        config: with every ``auto`` and ``null`` resolved.
        games: with the game's own options, and with those of ``config.practice``; may be one.
        teacher, opponent: in their seats.
        side: the student's seat.
        log_std: the teacher's, (a,); a student's, too.

    Attributes:
        collector, practice: play by the game's own options and by those of ``config.practice``.
        blocks: to learn from: standardised observations, labels in units of σ.
    """

    def __init__(
        self,
        config: DistillConfig,
        games: tuple[Game, Game],
        teacher: Policy,
        opponent: Policy,
        side: int,
        log_std: Tensor,
    ):
        assert config.network != "auto"
        assert config.hidden is not None
        assert config.block_steps is not None
        assert config.learning_rate is not None
        self.config, self.side, self.log_std = config, side, log_std
        self.teacher, self.opponent = teacher, opponent
        self.block_steps, self._rate = config.block_steps, config.learning_rate
        self.collector, self.practice = (
            Collector(game, teacher, opponent, log_std.exp(), config.seed) for game in games
        )
        self._sides = (side, 1 - side) if config.both_seats else (side,)
        seat = games[0].layout.sides[side]
        width, embed = (config.width, config.embed) if config.network == "lstm" else (0, 0)
        sizes = seat.observation_size, seat.action_size
        self.shape = NetworkShape(
            config.network, *sizes, width, config.hidden, config.observation_clip, embed
        )
        self.learner = StudentLearner(
            self.shape,
            minibatch=config.minibatch,
            gradient_length=config.gradient_length,
            learning_rate=self._rate,
            device=log_std.device,
        )
        self.standardize: Standardizer | None = None
        self.log: list[Entry] = []
        self.blocks: list[Block] = []

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
        error, fresh = self._round() if self.done < self.rounds else (self._final_pass(), None)
        self.log.append(Entry(self.done + 1, self.steps, error, fresh))
        return self.log[-1]

    def _round(self) -> tuple[float, float | None]:
        """Play a block and train on it and on other blocks."""
        number = len(self.blocks)
        block, fresh = self._play(number)
        self.blocks.append(block)
        generator = self._generator(f"replay {number}")
        error = 0.0
        for _ in range(self.config.passes_per_block):
            if number:
                earlier = int(torch.randint(number, (), generator=generator))
                self.learner.train(self.blocks[earlier], generator)
            error = self.learner.train(block, generator)
        return error, fresh

    def _play(self, number: int) -> tuple[Block, float | None]:
        """Play a block, and return it with the student's error there.

        Only the teacher acts in the first one; its observations standardise all that follow, these included.
        """
        # shifted by one at every block of true physics, so that each seat plays some of it
        side = self._sides[(number + number // _TRUE_BLOCKS) % len(self._sides)]
        games = self.practice if number % _TRUE_BLOCKS else self.collector
        roles = Roles.of(self.config.num_envs, self.log_std.device, teacher_only=not number)
        student = self.student() if number else None
        block, mean = games.play(f"block {number}", side, self.block_steps, roles, student)
        if self.standardize is None:
            self.standardize = self._statistics(block.observation)
        sigma, acted = self.log_std.exp(), ~roles.teacher_acts
        fresh = ((mean - block.label) / sigma)[:, acted].square().mean()
        block = Block(self.standardize(block.observation), block.label / sigma, block.done)
        return block, float(fresh) if number else None

    def _statistics(self, observation: Tensor) -> Standardizer:
        moments = RunningMoments(self.shape.observation_size).to(observation.device)
        for step in observation:
            moments.update(step)
        std = moments.var.sqrt().clamp(min=_LEAST_STD)
        return Standardizer(moments.mean.float(), std.float(), self.config.observation_clip)

    def _final_pass(self) -> float:
        """Train over all blocks, at a rate that falls linearly to zero over all final passes."""
        number = self.done - self.rounds
        generator = self._generator(f"final {number}")
        order = torch.randperm(len(self.blocks), generator=generator).tolist()
        errors = []
        for i, index in enumerate(order):
            left = 1 - (number + i / len(order)) / self.config.final_passes
            self.learner.set_learning_rate(self._rate * left)
            errors.append(self.learner.train(self.blocks[index], generator))
        return math.fsum(errors) / len(errors)

    def _generator(self, stream: str) -> torch.Generator:
        return stream_generator(self.config.seed, f"distillation {stream}", torch.device("cpu"))

    def weights(self) -> dict[str, Tensor]:
        """The student's present weights, as stored in its file."""
        assert self.standardize is not None, "there is a student after the first stage"
        return self.learner.weights(self.standardize.mean, self.standardize.std, self.log_std)

    def student(self) -> FrozenPolicy:
        """The present student as a policy, the one that its file will be."""
        info = PolicyInfo("student", "in memory", self.shape.observation_size, self.shape.action_size)
        return FrozenPolicy(info, self.shape, self.weights()).to(self.log_std.device)

    def state_dict(self) -> dict[str, Any]:
        """Return the state between two stages, without the blocks: they never change."""
        assert self.standardize is not None
        fixed = self.standardize
        return {
            "log": [asdict(entry) for entry in self.log],
            "standard": {"mean": fixed.mean, "std": fixed.std, "clip": fixed.clip},
            "learner": self.learner.state_dict(),
            "policies": {"teacher": self.teacher.info.sha256, "opponent": self.opponent.info.sha256},
        }

    def load_state_dict(self, state: Mapping[str, Any], blocks: Sequence[Block]) -> None:
        """Continue exactly where :meth:`state_dict` was taken.

        Raises:
            VictimError: the teacher or the opponent has changed since.
        """
        for who, policy in (("teacher", self.teacher), ("opponent", self.opponent)):
            if policy.info.sha256 != (expected := state["policies"][who]):
                raise VictimError(
                    f"the {who} {policy.info.name} has changed since the distillation began: "
                    f"SHA-256 {policy.info.sha256}, expected {expected}"
                )
        self.log = [Entry(**entry) for entry in state["log"]]
        self.standardize = Standardizer(**state["standard"]).to(self.log_std.device)
        self.learner.load_state_dict(state["learner"])
        self.blocks = list(blocks)

    def close(self) -> None:
        """Release the games."""
        self.collector.game.close()
        self.practice.game.close()
