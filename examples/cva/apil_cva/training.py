"""Minibatch regression for the surrogate and the predictor."""

from __future__ import annotations

from collections.abc import Iterator

import torch
from torch import Tensor, nn

ADAM_EPSILON = 1e-5
MAX_GRAD_NORM = 0.5


def minibatches(count: int, parts: int, epochs: int, generator: torch.Generator) -> Iterator[Tensor]:
    """Row numbers of ``epochs`` passes over ``count`` rows, each pass in ``parts`` random parts."""
    for _ in range(epochs):
        order = torch.randperm(count, generator=generator, device=generator.device)
        yield from order.chunk(parts)


def descend(loss: Tensor, module: nn.Module, optimizer: torch.optim.Optimizer) -> Tensor:
    """Take one step down ``loss``, the gradient clipped to norm 0.5; return the loss, detached."""
    optimizer.zero_grad()
    loss.backward()
    nn.utils.clip_grad_norm_(module.parameters(), MAX_GRAD_NORM)
    optimizer.step()
    return loss.detach()
