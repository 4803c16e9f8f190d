"""The student's updates: they lower the error, respect ends of games, and count as the docstring says."""

from __future__ import annotations

import math
from typing import Any

import pytest
import torch

from apil_core.api.types import DiagonalGaussian
from apil_core.policies.network import NetworkShape
from apil_core.runs.distillation.learner import Block, StudentLearner, kl_nats


def block(label: torch.Tensor, observation: torch.Tensor, done: torch.Tensor) -> Block:
    return Block(observation, label, done)


def learner(kind: Any, observation: int, action: int, minibatch: int = 64) -> StudentLearner:
    torch.manual_seed(0)
    width, hidden = (16, ()) if kind == "lstm" else (0, (16,))
    shape = NetworkShape(kind, observation, action, width, hidden, 5.0)
    cpu = torch.device("cpu")
    return StudentLearner(shape, minibatch=minibatch, gradient_length=4, learning_rate=1e-2, device=cpu)


def train(student: StudentLearner, data: Block, passes: int) -> float:
    generator = torch.Generator().manual_seed(1)
    return [student.train(data, generator) for _ in range(passes)][-1]


@pytest.mark.parametrize("kind", ["mlp", "lstm"])
def test_a_linear_teacher_is_learnt(kind: Any) -> None:
    z = torch.randn(20, 16, 3, generator=torch.Generator().manual_seed(2)).clamp(-2, 2)
    label = z @ torch.tensor([[1.0], [-0.5], [0.25]])
    data = block(label, z, torch.zeros(20, 16, dtype=torch.bool))
    assert train(learner(kind, 3, 1), data, 60) < 0.05 * float(label.square().mean())


def test_only_memory_that_ends_with_the_game_tells_the_first_cue() -> None:
    """The label repeats the cue of the first step of its game: not to be known without memory."""
    generator = torch.Generator().manual_seed(3)
    steps, games, length = 24, 64, 6
    cue = torch.randint(0, 2, (steps // length, games), generator=generator).float() * 2 - 1
    label = cue.repeat_interleave(length, 0).unsqueeze(-1)
    opening = (torch.arange(steps) % length == 0).float().view(-1, 1, 1)
    z = label * opening
    done = ((torch.arange(steps) % length) == length - 1).unsqueeze(1).expand(-1, games).contiguous()
    data = block(label, z, done)
    assert train(learner("lstm", 1, 1, minibatch=256), data, 60) < 0.1
    assert train(learner("mlp", 1, 1, minibatch=256), data, 60) > 0.7


def test_the_error_is_a_divergence() -> None:
    teacher = DiagonalGaussian(torch.tensor([[0.3, -1.0, 2.0]]), torch.tensor([0.5, 0.2, 1.5]))
    student = DiagonalGaussian(torch.tensor([[0.1, -0.9, 1.0]]), teacher.std)
    squared = float(((teacher.mean - student.mean) / teacher.std).square().mean())
    assert kl_nats(squared, 3) == pytest.approx(float(teacher.kl(student)))
    assert math.isclose(kl_nats(2.0, 17), 17.0)
