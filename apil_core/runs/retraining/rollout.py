"""What the victim did in one stretch of play, and the pieces of it that updates learn from."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import torch
from torch import Tensor

from apil_core.policies.network import LstmState


@dataclass
class Piece:
    """Part of a rollout, time first: stretches of games, or single steps in any order (T = 1).

    Attributes:
        z: standardised observations, (T, m, o).
        action: (T, m, a).
        done: a game ended with this step, (T, m) bool.
        log_prob, value, advantage, target: (T, m), before the update.
        actor_memory, critic_memory: before the first step.
    """

    z: Tensor
    action: Tensor
    done: Tensor
    log_prob: Tensor
    value: Tensor
    advantage: Tensor
    target: Tensor
    actor_memory: LstmState
    critic_memory: LstmState


@dataclass
class VictimRollout:
    """T steps of n games, written in place; the same memory serves every iteration.

    Attributes:
        z: standardised observations, (T, n, o).
        mean, action: (T, n, a).
        reward: normalised, (T, n).
        done: (T, n) bool.
        log_prob, value, advantage, target: (T, n); set before the update.
        actor_memory, critic_memory: at the start of the rollout.
        filled: steps recorded so far.
    """

    z: Tensor
    mean: Tensor
    action: Tensor
    reward: Tensor
    done: Tensor
    log_prob: Tensor
    value: Tensor
    advantage: Tensor
    target: Tensor
    actor_memory: LstmState
    critic_memory: LstmState
    filled: int = field(default=0, compare=False)

    @classmethod
    def empty(cls, steps: int, memory: LstmState, sizes: tuple[int, int, int]) -> VictimRollout:
        """Room for ``steps`` steps.

        Args:
            steps: T.
            memory: whatever; it tells the device.
            sizes: games n, observation o, action a.
        """
        (games, observation, action), device = sizes, memory[0].device

        def room(*last: int) -> Tensor:
            return torch.zeros(steps, games, *last, device=device)

        return cls(
            z=room(observation),
            mean=room(action),
            action=room(action),
            reward=room(),
            done=room().bool(),
            log_prob=room(),
            value=room(),
            advantage=room(),
            target=room(),
            actor_memory=memory,
            critic_memory=memory,
        )

    def record(self, reward: Tensor, done: Tensor) -> None:
        """How the step that began with :attr:`filled` ended: (n,) and (n,)."""
        self.reward[self.filled] = reward
        self.done[self.filled] = done
        self.filled += 1

    def games(self, parts: int, generator: torch.Generator) -> Iterator[Piece]:
        """Every step once, as whole games over all T steps, in ``parts`` pieces: for networks with memory."""
        columns = self._columns()
        for chosen in torch.randperm(self.done.shape[1], generator=generator).chunk(parts):
            (h, c), (critic_h, critic_c) = self.actor_memory, self.critic_memory
            yield Piece(
                **{name: column[:, chosen] for name, column in columns.items()},
                actor_memory=(h[chosen], c[chosen]),
                critic_memory=(critic_h[chosen], critic_c[chosen]),
            )

    def steps(self, parts: int, generator: torch.Generator, nothing: LstmState) -> Iterator[Piece]:
        """Every step once, in any order, in ``parts`` pieces with T = 1: for networks without memory."""
        flat = {name: column.flatten(0, 1) for name, column in self._columns().items()}
        for rows in torch.randperm(self.done.numel(), generator=generator).chunk(parts):
            piece = {name: column[rows].unsqueeze(0) for name, column in flat.items()}
            yield Piece(**piece, actor_memory=nothing, critic_memory=nothing)

    def _columns(self) -> dict[str, Tensor]:
        names = ("z", "action", "done", "log_prob", "value", "advantage", "target")
        return {name: getattr(self, name) for name in names}
