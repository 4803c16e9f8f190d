"""The student's training, on rsl_rl's Distillation, models and storage.

Where rsl_rl's Distillation would not hold is arranged here:

* It drops a recurrent teacher's state at every update, so the teacher stays outside: it labels while
  the games are played, and the ``teacher`` rsl_rl gets only repeats its labels.
* It trains on a rollout once; physics is what costs, so blocks are kept and trained on again (DAgger's
  aggregated data set). Every block begins new games: the recurrent state it starts from is always zero.
* It gives a student's standard deviation no gradient, so the student has none: the teacher's is copied,
  and labels are in its units. Half the squared error, summed, is then KL(teacher ‖ student) in nats.
"""

from __future__ import annotations

import copy
import math
import warnings
from collections.abc import Iterator
from typing import Any

import torch
from rsl_rl.algorithms import Distillation
from rsl_rl.models import MLPModel, RNNModel
from rsl_rl.storage import RolloutStorage
from tensordict import TensorDict
from torch import Tensor, nn

from apil_core.victims.student_policy import StudentShape

_GROUP = "observation"


class _Labels(nn.Module):
    """Stands where rsl_rl expects a teacher, and repeats what the real one said."""

    def __init__(self) -> None:
        super().__init__()
        self.now = torch.empty(0)

    def forward(self, observations: TensorDict) -> Tensor:
        return self.now

    def reset(self, dones: Tensor | None = None, hidden_state: Any = None) -> None:
        """Nothing: the real teacher keeps its own state."""

    def get_hidden_state(self) -> None:
        return None


class StudentLearner:
    """A student's network and its updates; everything in standardised observations and units of σ.

    Args:
        shape: of the student.
        num_envs: games stepped together.
        block_steps: T, steps per block.
        minibatch_envs: games behind each gradient.
        gradient_length: steps behind each gradient.
        learning_rate: Adam's.
        max_grad_norm: gradient clip, per step behind the gradient.
        device: of the networks.
    """

    def __init__(
        self,
        shape: StudentShape,
        *,
        num_envs: int,
        block_steps: int,
        minibatch_envs: int,
        gradient_length: int,
        learning_rate: float,
        max_grad_norm: float,
        device: torch.device,
    ):
        self.shape = shape
        self._block_steps = block_steps
        self._minibatch_envs = minibatch_envs
        self._example = TensorDict(
            {_GROUP: torch.zeros(num_envs, shape.observation_size)}, batch_size=[num_envs], device=device
        )
        self._device = str(device)
        self._labels = _Labels()
        self.model = self._model().to(device)
        with warnings.catch_warnings():
            # steps that do not fill a gradient_length are left out of a pass: known, and less than 4 %
            warnings.filterwarnings("ignore", message="The product of 'num_learning_epochs'")
            self._distillation = Distillation(
                self.model,
                self._labels,
                self.new_block(),
                gradient_length=gradient_length,
                learning_rate=learning_rate,
                max_grad_norm=max_grad_norm * gradient_length,
                device=self._device,
            )

    def _model(self) -> MLPModel:
        shape, groups = self.shape, {"student": [_GROUP]}
        layers = {"hidden_dims": shape.hidden, "activation": "elu"}
        if shape.kind == "mlp":
            return MLPModel(self._example, groups, "student", shape.action_size, **layers)
        rnn = {"rnn_type": shape.kind, "rnn_hidden_dim": shape.width}
        return RNNModel(self._example, groups, "student", shape.action_size, **layers, **rnn)

    def new_block(self) -> RolloutStorage:
        """Room for one block."""
        envs = self._example.batch_size[0]
        return RolloutStorage(
            "distillation", envs, self._block_steps, self._example, [self.shape.action_size], self._device
        )

    def begin(self, block: RolloutStorage) -> None:
        """Record into ``block`` from now on; new games begin."""
        block.clear()
        self._distillation.storage = block
        self.model.reset()

    def act(self, observation: Tensor, label: Tensor) -> Tensor:
        """The student's mean action, and the teacher's noted beside it; (n, o), (n, a) → (n, a)."""
        self._labels.now = label
        return self._distillation.act(TensorDict({_GROUP: observation}, batch_size=[len(observation)]))

    def record(self, done: Tensor) -> None:
        """End of the step: (n,) bool, where a game ended."""
        nothing = torch.zeros(len(done), device=done.device)
        self._distillation.process_env_step(None, nothing, done, {})

    def train(self, block: RolloutStorage) -> float:
        """One pass over a block; gives the mean squared error before each gradient, in units of σ²."""
        self.model.train()
        errors = []
        for part in self._parts(block):
            self._distillation.storage = part
            self._distillation.last_hidden_states = (None, None)
            errors.append(self._distillation.update()["behavior"])
        return math.fsum(errors) / len(errors)

    def _parts(self, block: RolloutStorage) -> Iterator[RolloutStorage]:
        """Views of ``minibatch_envs`` games each (the last may have fewer)."""
        size = self._minibatch_envs
        for begin in range(0, block.num_envs, size):
            part, games = copy.copy(block), slice(begin, begin + size)
            part.observations = block.observations[:, games]
            part.privileged_actions = block.privileged_actions[:, games]
            part.dones = block.dones[:, games]
            yield part

    def set_learning_rate(self, rate: float) -> None:
        """For the passes that follow."""
        for group in self._distillation.optimizer.param_groups:
            group["lr"] = rate

    def weights(self, mean: Tensor, std: Tensor, log_std: Tensor) -> dict[str, Tensor]:
        """The student's tensors as its file has them, on the CPU.

        Args:
            mean, std: of the observations, (o,).
            log_std: the teacher's, (a,); the output layer is put into its units.
        """
        state = {name: tensor.detach().cpu().float() for name, tensor in self.model.state_dict().items()}
        found = {"observation.mean": mean, "observation.std": std, "log_std": log_std}
        for name in ("weight_ih", "weight_hh", "bias_ih", "bias_hh"):
            if self.shape.kind != "mlp":
                found[f"rnn.{name}"] = state[f"rnn.rnn.{name}_l0"]
        last = len(self.shape.hidden)
        for i in range(last + 1):  # every other module of rsl_rl's MLP is an activation
            for part in ("weight", "bias"):
                found[f"mlp.{i}.{part}"] = state[f"mlp.{2 * i}.{part}"]
        sigma = log_std.exp()
        found[f"mlp.{last}.weight"] = found[f"mlp.{last}.weight"] * sigma.unsqueeze(1)
        found[f"mlp.{last}.bias"] = found[f"mlp.{last}.bias"] * sigma
        return {name: tensor.cpu().float().clone() for name, tensor in found.items()}

    def state_dict(self) -> dict[str, Any]:
        """Network and optimiser."""
        return dict(self._distillation.save())

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore what :meth:`state_dict` gave."""
        self._distillation.load(state, {"student": True, "optimizer": True}, strict=True)


def kl_nats(squared_error: float, action_size: int) -> float:
    """KL(teacher ‖ student) of a mean squared error in units of σ², in nats per step."""
    return 0.5 * squared_error * action_size


def block_tensors(block: RolloutStorage) -> dict[str, Tensor]:
    """What a block holds: observations (T, n, o), labels (T, n, a), ends of games (T, n, 1)."""
    return {
        "observation": block.observations[_GROUP],
        "label": block.privileged_actions,
        "done": block.dones,
    }
