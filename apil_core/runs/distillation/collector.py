"""Collect the games a student learns from: the student acts, the teacher labels (DAgger)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from apil_core.api.game import Game
from apil_core.api.policy import Policy
from apil_core.api.types import View
from apil_core.common.errors import VictimError
from apil_core.common.seeds import stream_generator, stream_seed
from apil_core.runs.distillation.opponents import PerturbedOpponent

OnStep = Callable[[int], None]


@dataclass
class Sample:
    """One step of all games, from the student's side.

    Attributes:
        observation: as the game gave it, (n, o).
        label: the teacher's mean action, (n, a).
        done: (n,) bool, the game ended with this step.
    """

    observation: Tensor
    label: Tensor
    done: Tensor


@dataclass(frozen=True)
class Roles:
    """Roles of the policies in each game, each (n,) bool, fixed over a block.

    Attributes:
        teacher_acts: the teacher plays, so that the data keep the states it reaches; else the student.
        sampled: actions are drawn; else the mode is taken.
        perturbed: against :class:`PerturbedOpponent`; else against the opponent as it is.
    """

    teacher_acts: Tensor
    sampled: Tensor
    perturbed: Tensor

    @classmethod
    def of(cls, num_envs: int, device: torch.device, *, teacher_only: bool) -> Roles:
        """Rows by index: teacher in every 4th, perturbed opponent in every other 4, mode in every 4th 16."""
        row = torch.arange(num_envs, device=device)
        teacher = torch.ones_like(row, dtype=torch.bool) if teacher_only else row % 4 == 3
        return cls(teacher, row // 16 % 4 != 3, row // 4 % 2 == 1)


class Collector:
    """Plays blocks of games with the student, the teacher and the opponent.

    Args:
        game: stepped here; reseeded for every block.
        teacher: policy with a distribution.
        opponent: in the other seat.
        std: standard deviation of the student's draws, (a,).
        seed: of the distillation.
        device: of the networks.
    """

    def __init__(
        self, game: Game, teacher: Policy, opponent: Policy, std: Tensor, seed: int, device: torch.device
    ):
        self.game = game
        self.teacher = teacher
        self.opponent = opponent
        self._std = std
        self._seed = seed
        self._device = device

    @torch.no_grad()
    def play(
        self,
        name: str,
        side: int,
        steps: int,
        roles: Roles,
        act: Callable[[Tensor, Tensor], Tensor] | None,
        take: Callable[[Sample], None],
    ) -> None:
        """Start new games and play ``steps`` steps of each; a function of ``name``, the seed and the student.

        Args:
            name: of this stretch of play; names its random streams.
            side: the student's seat.
            steps: per game.
            roles: of the policies, by game.
            act: the student's mean action for observations (n, o) and labels (n, a), (n, a); ``None``
                where only the teacher acts.
            take: gets every step.

        Raises:
            VictimError: the teacher has no distribution whose mean could be learnt.
        """
        game, device = self.game, self._device
        generator = stream_generator(self._seed, f"distillation {name}", device)
        against = PerturbedOpponent(self.opponent, roles.perturbed, generator)
        game.seed(stream_seed(self._seed, f"distillation games {name}"))
        for who, policy in (("teacher", self.teacher), ("opponent", self.opponent)):
            policy.seed(stream_seed(self._seed, f"distillation {who} {name}"))  # generators of its own
        game.reset()
        first = torch.ones(game.num_envs, dtype=torch.bool, device=device)
        for _ in range(steps):
            own, other = (torch.from_numpy(game.observations[i]).to(device) for i in (side, 1 - side))
            label = self._label(View(own, other, first))
            mean = (
                label if act is None else torch.where(roles.teacher_acts.unsqueeze(1), label, act(own, label))
            )
            noise = torch.randn(mean.shape, generator=generator, device=device) * self._std
            action = mean + noise * roles.sampled.unsqueeze(1)
            answer = against.act(View(other, own, first))
            first = self._step(side, action, answer)
            take(Sample(own, label, first))

    def _label(self, view: View) -> Tensor:
        distribution = self.teacher.act(view, sample=False).distribution
        if distribution is None:
            raise VictimError(
                f"{self.teacher.info.name} has no action distribution: its mean cannot be learnt"
            )
        return distribution.mean

    def _step(self, side: int, action: Tensor, answer: Tensor) -> Tensor:
        chosen = {side: action.cpu().numpy(), 1 - side: answer.cpu().numpy()}
        done = np.array(self.game.step((chosen[0], chosen[1])).done)
        if done.any():
            self.game.reset(done)
        return torch.from_numpy(done).to(self._device)
