"""Running normalisation of observations and rewards (docs/methods.md §1), as PPO implementations do it.

Statistics are float64 (a run adds tens of millions of samples), results float32.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn

_EPSILON = 1e-8
_PART = 512
"""Rows converted to double precision at a time."""


class RunningMoments(nn.Module):
    """Mean and variance over all rows seen, by the parallel formula of Chan et al. (1979).

    Args:
        size: length of a row.

    Attributes:
        mean, var: (size,) float64, zeros and ones before the first row.
        count: () float64, rows seen.
    """

    mean: Tensor
    var: Tensor
    count: Tensor

    def __init__(self, size: int):
        super().__init__()
        self.register_buffer("mean", torch.zeros(size, dtype=torch.float64))
        self.register_buffer("var", torch.ones(size, dtype=torch.float64))
        self.register_buffer("count", torch.zeros((), dtype=torch.float64))

    @torch.no_grad()
    def update(self, rows: Tensor) -> None:
        """Update with ``rows``, shape (m, size)."""
        count = rows.shape[0]
        if count == 0:
            return
        if self.mean.numel() == 1:
            self._update_column(rows[:, 0].double())
            return
        mean, var = _moments(rows)
        before = float(self.count)
        total = before + count
        if not before:
            self.mean.copy_(mean)
            self.var.copy_(var)
        else:
            share = count / total
            delta = mean - self.mean
            self.var.mul_(1 - share).add_(share * var + delta.square() * (share * (1 - share)))
            self.mean.add_(delta * share)
        self.count.fill_(total)

    def _update_column(self, values: Tensor) -> None:
        """:meth:`update` in Python floats.

        Every step has several of these, and a tensor of one element costs as much as a long one.
        """
        count = len(values)
        var, mean = map(float, torch.var_mean(values, correction=0))
        before = float(self.count)
        total = before + count
        if before:
            share, old = count / total, float(self.mean)
            delta = mean - old
            var = float(self.var) * (1 - share) + (share * var + delta * delta * (share * (1 - share)))
            mean = old + delta * share
        for buffer, value in ((self.mean, mean), (self.var, var), (self.count, total)):
            buffer.fill_(value)


def _moments(rows: Tensor) -> tuple[Tensor, Tensor]:
    """Mean and variance of ``rows`` (m, k), each (k,), float64.

    In parts that stay in the processor's cache: a rollout in double precision does not.
    """
    count = rows.shape[0]
    if count <= _PART:
        doubled = rows.to(torch.float64, copy=True)
        mean = doubled.sum(0) / count
        return mean, doubled.sub_(mean).square_().sum(0) / count
    parts = rows.split(_PART)
    mean = torch.stack([part.double().sum(0) for part in parts]).sum(0) / count
    squares = [part.to(torch.float64, copy=True).sub_(mean).square_().sum(0) for part in parts]
    return mean, torch.stack(squares).sum(0) / count


class ObservationNormalizer(nn.Module):
    """``clip((x - mean) / std, ±clip)`` with running mean and standard deviation per component.

    Args:
        size: length of an observation.
        clip: bound of the result.
    """

    shift: Tensor
    scale: Tensor

    def __init__(self, size: int, clip: float = 10.0):
        super().__init__()
        self.clip = clip
        self.moments = RunningMoments(size)
        # float32 copies of the moments: no conversion at every step of the hot loop
        self.register_buffer("shift", torch.zeros(size))
        self.register_buffer("scale", torch.ones(size))

    def update(self, observations: Tensor) -> None:
        """Update with observations, shape (m, size)."""
        self.moments.update(observations)
        self.shift.copy_(self.moments.mean)
        self.scale.copy_((self.moments.var + _EPSILON).rsqrt())

    def forward(self, observations: Tensor) -> Tensor:
        """Normalise, shape (..., size) → (..., size)."""
        return (observations - self.shift).mul_(self.scale).clamp_(-self.clip, self.clip)


class ReturnNormalizer(nn.Module):
    """Divides a reward by the running standard deviation of its discounted return, clipped.

    The return of each game is ``R_t = γ R_{t-1} + r_t``, restarted when a game ends.

    Args:
        num_envs: number of games.
        gamma: discount per step.
        clip: bound of the result.
    """

    returns: Tensor

    def __init__(self, num_envs: int, gamma: float, clip: float = 10.0):
        super().__init__()
        self.gamma = gamma
        self.clip = clip
        self.moments = RunningMoments(1)
        self.register_buffer("returns", torch.zeros(num_envs, dtype=torch.float64))

    @torch.no_grad()
    def update(self, reward: Tensor, done: Tensor) -> Tensor:
        """Update with one step's rewards (n,) and end flags (n,); returns normalised rewards, (n,)."""
        self.returns.mul_(self.gamma).add_(reward)
        self.moments.update(self.returns.unsqueeze(-1))
        self.returns.masked_fill_(done, 0.0)
        return self(reward)

    def forward(self, reward: Tensor) -> Tensor:
        """Normalise with the current statistics, shape unchanged."""
        # The very first rewards may all be zero: without spread there is nothing to divide by.
        scale = 1 / math.sqrt(float(self.moments.var) + _EPSILON)
        return (reward * scale).clamp_(-self.clip, self.clip)
