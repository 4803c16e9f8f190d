"""Pooling the running statistics of several processes."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor, nn

from apil_core.training.distributed.world import World
from apil_core.training.normalize import ObservationNormalizer, RunningMoments


def pooled(mean: Tensor, var: Tensor, count: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Mean and variance of all samples of N processes together, by the law of total variance.

    Each process continues from the last pooled statistics, so the samples up to then are in all N of them.
    The count is therefore the *mean* of the counts: it represents N times as many samples, old samples keep
    their weight relative to new ones, and pooling again is exact.

    Args:
        mean, var: of each process, (N, k).
        count: of each process, (N,); not all zero.

    Returns:
        mean (k,), variance (k,), count ().
    """
    weight = (count / count.sum()).unsqueeze(-1)
    middle = (weight * mean).sum(0)
    spread = (weight * (var + (mean - middle).square())).sum(0)
    return middle, spread, count.mean()


@torch.no_grad()
def pool(world: World, modules: Sequence[nn.Module]) -> None:
    """Give all :class:`RunningMoments` among ``modules`` the statistics of all processes; one exchange.

    Observation normalisers among them use the new statistics afterwards.
    """
    moments = [module for module in modules if isinstance(module, RunningMoments)]
    for module, (mean, var, count) in zip(moments, _gathered(world, moments), strict=True):
        if count.any():
            ours = pooled(mean, var, count)
            module.mean.copy_(ours[0])
            module.var.copy_(ours[1])
            module.count.copy_(ours[2])
    for normalizer in modules:
        if isinstance(normalizer, ObservationNormalizer):
            # no rows: nothing but the float32 copies of the statistics changes
            normalizer.update(normalizer.shift.new_empty(0, normalizer.shift.numel()))


def _gathered(world: World, moments: Sequence[RunningMoments]) -> list[tuple[Tensor, Tensor, Tensor]]:
    """Of each of ``moments`` every process's mean (N, k), variance (N, k) and count (N,)."""
    from torch import distributed

    if not moments:
        return []
    device = moments[0].mean.device
    own = torch.cat([part.reshape(-1).to(device) for m in moments for part in (m.mean, m.var, m.count)])
    rows = [torch.empty_like(own) for _ in range(world.size)]
    distributed.all_gather(rows, own)
    result = []
    sizes = [size for m in moments for size in (m.mean.numel(), m.var.numel(), 1)]
    parts = torch.stack(rows).split(sizes, dim=1)
    for mean, var, count in zip(parts[0::3], parts[1::3], parts[2::3], strict=True):
        result.append((mean, var, count[:, 0]))
    return result
