"""The discriminator of GAIL: did the victim do this?"""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from apil_apil.config import DiscriminatorConfig


class Discriminator(nn.Module):
    """D(s, a) = σ(logit), tanh layers on state and action.

    The first layer is split by its input, so that two actions in one state (the victim's and the
    imitator's) cost the large state product once.

    Args:
        state_size: length of the (normalised) state.
        action_size: of the victim.
        config: layers and bound.
    """

    def __init__(self, state_size: int, action_size: int, config: DiscriminatorConfig):
        super().__init__()
        self.config = config
        first, *others = config.hidden
        self.state = nn.Linear(state_size, first)
        self.action = nn.Linear(action_size, first, bias=False)
        layers: list[nn.Module] = []
        for inputs, outputs in zip([first, *others], [*others, 1], strict=True):
            layers += [nn.Tanh(), nn.Linear(inputs, outputs)]
        self.head = nn.Sequential(*layers)
        _initialise([self.state, *(m for m in self.head if isinstance(m, nn.Linear))])
        nn.init.orthogonal_(self.action.weight, gain=math.sqrt(2))

    def logits(self, state: Tensor, *actions: Tensor) -> list[Tensor]:
        """Logit of D for each of ``actions`` (…, a) in ``state`` (…, s), each (…,)."""
        base = self.state(state)
        results = []
        for action in actions:
            logit = self.head(base + self.action(action))[..., 0]
            results.append(torch.tanh(logit) if self.config.logit_bound == "tanh" else logit)
        return results


def _initialise(layers: Sequence[nn.Linear]) -> None:
    for layer in layers:
        nn.init.orthogonal_(layer.weight, gain=1.0 if layer is layers[-1] else math.sqrt(2))
        nn.init.zeros_(layer.bias)


def imitation_loss(victim_logits: Tensor, imitator_logits: Tensor) -> Tensor:
    """Binary cross-entropy, label 1 for the victim, 0 for the imitator (docs/methods.md §2).

    The paper prints min over D of the log-likelihoods, which moves the same way but has its optimum
    at the bounds; descending the cross-entropy is what GAIL does (Ho & Ermon 2016, algorithm 1).
    """
    return F.softplus(-victim_logits).mean() + F.softplus(imitator_logits).mean()


def reward_log_d(logits: Tensor) -> Tensor:
    """log D, shape unchanged; in (−∞, 0)."""
    return F.logsigmoid(logits)


def reward_neg_log_1md(logits: Tensor) -> Tensor:
    """−log(1 − D), shape unchanged; in (0, ∞)."""
    return F.softplus(logits)
