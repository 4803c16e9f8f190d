"""A perturbed opponent, so that a student also learns on states that an attack would reach."""

from __future__ import annotations

import torch
from torch import Tensor

from apil_core.api.policy import Policy
from apil_core.api.types import DiagonalGaussian, View


class PerturbedOpponent:
    """Plays ``keep · a + s · ε`` in some games, where ``a`` is the opponent's own action and ε is noise.

    For each new game ``keep`` is 1 in a half of the cases, 0 in a quarter (it falls over, or flails) and
    between them in the rest; ``s`` is uniform in [0, 1.5]. Games outside the mask are played as given.

    Args:
        policy: the opponent.
        perturbed: (n,) bool, the games concerned.
        generator: of all draws.
    """

    def __init__(self, policy: Policy, perturbed: Tensor, generator: torch.Generator):
        self.policy = policy
        self._perturbed = perturbed
        self._generator = generator
        self._keep = torch.ones(len(perturbed), 1, device=perturbed.device)
        self._noise = torch.zeros(len(perturbed), 1, device=perturbed.device)

    def act(self, view: View) -> Tensor:
        """Actions for the games' present observations, (n, a)."""
        new = view.first & self._perturbed
        if new.any():
            self._draw(new)
        action = self.policy.act(view, sample=True, generator=self._generator).action
        noise = DiagonalGaussian(torch.zeros_like(action), torch.ones_like(action)).sample(self._generator)
        return self._keep * action + self._noise * noise

    def _draw(self, new: Tensor) -> None:
        kind, share, size = torch.rand(
            (3, len(new)), generator=self._generator, device=self._keep.device
        ).unbind()
        keep = torch.where(kind < 0.5, 1.0, torch.where(kind < 0.75, 0.0, share))
        self._keep[new, 0] = keep[new]
        self._noise[new, 0] = 1.5 * size[new]
