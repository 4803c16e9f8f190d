"""The student's network and its updates, in standardised observations and units of σ.

This is what rsl_rl's ``Distillation`` does (mean squared error to the teacher's mean, truncated
backpropagation through time), reimplemented because that one does not fit: it passes over a rollout one
step of all games at a time and only once, drops a recurrent teacher's state at every update, and leaves
the student's spread without gradient. Physics is the main cost, so blocks are kept and reused many times;
with the products that do not depend on the recurrence taken together a pass is several times as fast
(docs/victims.md). Labels are in units of the teacher's σ, which is copied: half the squared error, summed
over components, is then KL(teacher ‖ student) in nats.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor, nn

from apil_core.policies.network import NetworkShape, PolicyNetwork


@dataclass
class Block:
    """The steps of one round, time first; to learn from, observations are standardised and labels in σ.

    Attributes:
        observation: (T, n, o).
        label: the teacher's mean action, (T, n, a).
        done: (T, n) bool, a game ended with this step.
    """

    observation: Tensor
    label: Tensor
    done: Tensor

    @classmethod
    def empty(cls, steps: int, games: int, observation: int, action: int, device: torch.device) -> Block:
        """Allocate an empty block of those sizes."""
        return cls(
            torch.zeros(steps, games, observation, device=device),
            torch.zeros(steps, games, action, device=device),
            torch.zeros(steps, games, dtype=torch.bool, device=device),
        )


class StudentLearner:
    """A student's network and optimiser.

    Args:
        shape: of the student.
        minibatch: steps of games behind each gradient.
        gradient_length: steps of backpropagation through time.
        learning_rate: Adam's.
        device: of the network.
    """

    def __init__(
        self,
        shape: NetworkShape,
        *,
        minibatch: int,
        gradient_length: int,
        learning_rate: float,
        device: torch.device,
    ):
        self.shape = shape
        self.network = PolicyNetwork(shape).to(device)
        self._minibatch = minibatch
        self._length = gradient_length
        self._optimizer = torch.optim.Adam(self.network.parameters(), lr=learning_rate)

    def train(self, block: Block, generator: torch.Generator) -> float:
        """Train one pass over a block; return the mean squared error before each gradient, in units of σ².

        Args:
            block: whole.
            generator: of the order, on the CPU.
        """
        parts = self._games(block, generator) if self.shape.kind == "lstm" else self._rows(block, generator)
        errors = [self._learn(error) for error in parts]
        return float(torch.stack(errors).mean())

    def _rows(self, block: Block, generator: torch.Generator) -> Iterator[Tensor]:
        """Errors of minibatches of steps in random order."""
        z, label = block.observation.flatten(0, 1), block.label.flatten(0, 1)
        no_reset = torch.zeros(1, 1, dtype=torch.bool, device=z.device)
        nothing = self.network.zero_state(1)
        for rows in torch.randperm(len(z), generator=generator).split(self._minibatch):
            mean, _ = self.network(z[rows].unsqueeze(0), no_reset, nothing)
            yield (mean[0] - label[rows]).square().mean()

    def _games(self, block: Block, generator: torch.Generator) -> Iterator[Tensor]:
        """Errors of stretches of ``gradient_length`` steps, in order of time, for several games at once."""
        games = max(self._minibatch // self._length, 1)
        for chosen in torch.randperm(block.done.shape[1], generator=generator).split(games):
            z, label, done = (part[:, chosen] for part in (block.observation, block.label, block.done))
            memory = self.network.zero_state(len(chosen))
            for begin in range(0, len(z), self._length):
                stretch = slice(begin, begin + self._length)
                mean, (h, c) = self.network(z[stretch], done[stretch], memory)
                memory = h.detach(), c.detach()
                yield (mean - label[stretch]).square().mean()

    def _learn(self, error: Tensor) -> Tensor:
        self._optimizer.zero_grad(set_to_none=True)
        error.backward()
        nn.utils.clip_grad_norm_(self.network.parameters(), 1.0)
        self._optimizer.step()
        return error.detach()

    def set_learning_rate(self, rate: float) -> None:
        """Set the learning rate of the following passes."""
        for group in self._optimizer.param_groups:
            group["lr"] = rate

    def weights(self, mean: Tensor, std: Tensor, log_std: Tensor) -> dict[str, Tensor]:
        """The student's tensors as stored in its file, on the CPU.

        Args:
            mean, std: of the observations, (o,).
            log_std: the teacher's, (a,); the output layer is put into its units.
        """
        found = {"observation.mean": mean, "observation.std": std, "log_std": log_std}
        found |= {name: tensor.detach() for name, tensor in self.network.state_dict().items()}
        last, sigma = f"mlp.{len(self.shape.hidden)}", log_std.exp()
        found[f"{last}.weight"] = found[f"{last}.weight"] * sigma.unsqueeze(1)
        found[f"{last}.bias"] = found[f"{last}.bias"] * sigma
        return {name: tensor.cpu().float().clone() for name, tensor in found.items()}

    def state_dict(self) -> dict[str, Any]:
        """Return network and optimiser."""
        return {"network": self.network.state_dict(), "optimizer": self._optimizer.state_dict()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore what :meth:`state_dict` returned."""
        self.network.load_state_dict(state["network"])
        self._optimizer.load_state_dict(state["optimizer"])


def kl_nats(squared_error: float, action_size: int) -> float:
    """KL(teacher ‖ student), in nats per step, from a mean squared error in units of σ²."""
    return 0.5 * squared_error * action_size
