"""Play the games a student learns from: the student acts, the teacher labels (DAgger)."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from apil_core.api.game import Game
from apil_core.api.policy import Policy
from apil_core.common.seeds import stream_generator, stream_seed
from apil_core.games.two_players import TwoPlayerGames
from apil_core.runs.distillation.learner import Block
from apil_core.runs.distillation.opponents import PerturbedOpponent


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


@dataclass(frozen=True)
class Collector:
    """Plays blocks of games with the student, the teacher and the opponent.

    Attributes:
        game: stepped here; reseeded for every block.
        teacher: policy with a distribution.
        opponent: in the other seat.
        std: standard deviation of the student's draws, (a,), on the device of the policies.
        seed: of the distillation.
    """

    game: Game
    teacher: Policy
    opponent: Policy
    std: Tensor
    seed: int

    @torch.no_grad()
    def play(
        self, name: str, side: int, steps: int, roles: Roles, student: Policy | None
    ) -> tuple[Block, Tensor]:
        """Start new games and play ``steps`` steps of each; a function of ``name``, the seed and the student.

        Args:
            name: of this stretch of play; names its random streams.
            side: the student's seat.
            steps: per game.
            roles: of the policies, by game.
            student: acts where the teacher does not; ``None``: only the teacher acts.

        Returns:
            the steps, observations as the game gave them, and the student's mean actions, (T, n, a).
        """
        device, seat = self.std.device, self.game.layout.sides[side]
        generator = stream_generator(self.seed, f"distillation {name}", device)
        against = PerturbedOpponent(self.opponent, roles.perturbed, generator)
        self.game.seed(stream_seed(self.seed, f"distillation games {name}"))
        for who, policy in (("teacher", self.teacher), ("opponent", self.opponent)):
            policy.seed(stream_seed(self.seed, f"distillation {who} {name}"))  # generators of its own
        block = Block.empty(steps, self.game.num_envs, seat.observation_size, seat.action_size, device)
        means = torch.zeros_like(block.label)
        games = TwoPlayerGames(self.game, device)
        games.reset()
        for t in range(steps):
            view = games.view(side)
            answer = self.teacher.act(view, sample=False).distribution
            assert answer is not None, "checked when it was loaded"
            label = answer.mean
            mean = label if student is None else student.act(view, sample=False).action
            acted = torch.where(roles.teacher_acts.unsqueeze(1), label, mean)
            noise = torch.randn(acted.shape, generator=generator, device=device) * self.std
            action = acted + noise * roles.sampled.unsqueeze(1)
            block.observation[t], block.label[t], means[t] = view.own, label, mean
            done = games.step({side: action, 1 - side: against.act(games.view(1 - side))}).done
            block.done[t] = torch.from_numpy(done)
            games.reset(done)
        return block, means
