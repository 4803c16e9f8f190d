"""One TRPO step (Schulman et al. 2015) for a Gaussian policy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from apil_core import DiagonalGaussian


@dataclass
class TrustRegion:
    """Settings of the step.

    Attributes:
        kl: largest mean KL(old ‖ new) in nats.
        cg_steps: conjugate-gradient steps.
        damping: added to the Fisher matrix's diagonal.
        backtracks: halvings of the step before it is given up.
    """

    kl: float = 0.01
    cg_steps: int = 10
    damping: float = 0.1
    backtracks: int = 10


def trpo_step(
    policy: nn.Module,
    observations: Tensor,
    surrogate: Callable[[DiagonalGaussian, DiagonalGaussian], Tensor],
    region: TrustRegion,
    fisher_rows: Tensor,
) -> dict[str, float]:
    """Move ``policy`` along the natural gradient as far as the trust region allows.

    Solves F x = g by conjugate gradients, scales to √(2 δ / xᵀFx) (eq. 6 of appendix C), and halves
    the step until the surrogate improves and mean KL ≤ δ; otherwise leaves the policy as it was.

    Args:
        policy: maps observations (m, o) to a :class:`DiagonalGaussian`; changed in place.
        observations: (m, o).
        surrogate: objective to raise, a scalar of the new and the old distribution at ``observations``.
        region: see :class:`TrustRegion`.
        fisher_rows: indices of the rows the Fisher matrix is estimated on.

    Returns:
        ``kl`` and ``improvement`` of the accepted step (0 if none), and ``accepted`` (0 or 1).
    """
    parameters = list(policy.parameters())
    new = policy(observations)
    old = DiagonalGaussian(new.mean.detach(), new.std.detach())
    objective = surrogate(new, old)
    before = float(objective.detach())
    gradient = _flat(torch.autograd.grad(objective, parameters))
    product = _fisher_product(policy, parameters, observations[fisher_rows], region.damping)
    direction = conjugate_gradient(product, gradient, region.cg_steps)
    curvature = float(direction @ product(direction))
    failed = {"kl": 0.0, "improvement": 0.0, "accepted": 0.0}
    if not curvature > 0 or not torch.isfinite(direction).all():
        return failed
    step = direction * (2 * region.kl / curvature) ** 0.5
    start = nn.utils.parameters_to_vector(parameters).detach().clone()
    for i in range(region.backtracks):
        _set(parameters, start + step * 0.5**i)
        with torch.no_grad():
            new = policy(observations)
            kl, gain = float(old.kl(new).mean()), float(surrogate(new, old)) - before
        if gain > 0 and kl <= region.kl:
            return {"kl": kl, "improvement": gain, "accepted": 1.0}
    _set(parameters, start)
    return failed


def conjugate_gradient(product: Callable[[Tensor], Tensor], b: Tensor, steps: int) -> Tensor:
    """Approximate solution x of A x = b, A symmetric positive definite and given by its products."""
    x, residual, search = torch.zeros_like(b), b.clone(), b.clone()
    energy = residual @ residual
    for _ in range(steps):
        if energy < 1e-10:
            break
        image = product(search)
        alpha = energy / (search @ image)
        x += alpha * search
        residual -= alpha * image
        following = residual @ residual
        search = residual + (following / energy) * search
        energy = following
    return x


def _fisher_product(
    policy: nn.Module, parameters: list[nn.Parameter], observations: Tensor, damping: float
) -> Callable[[Tensor], Tensor]:
    new = policy(observations)
    old = DiagonalGaussian(new.mean.detach(), new.std.detach())
    # at equal distributions KL's Hessian is the Fisher matrix
    gradient = _flat(torch.autograd.grad(old.kl(new).mean(), parameters, create_graph=True))

    def product(vector: Tensor) -> Tensor:
        second = torch.autograd.grad(gradient @ vector, parameters, retain_graph=True)
        return _flat(second) + damping * vector

    return product


def _flat(tensors: tuple[Tensor, ...]) -> Tensor:
    return torch.cat([tensor.reshape(-1) for tensor in tensors])


@torch.no_grad()
def _set(parameters: list[nn.Parameter], vector: Tensor) -> None:
    nn.utils.vector_to_parameters(vector, parameters)
