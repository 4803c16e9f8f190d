"""The discriminator of GAIL, a classifier of the victim's and the imitator's actions."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from apil_apil.config import DiscriminatorConfig
from apil_apil.critic import batches

_PENALTY_EVERY = 4
"""Minibatches for each one with the gradient penalty, which then counts as often (Karras et al. 2020, lazy
regularisation): a second derivative in every one would cost half as much again."""

Pairs = tuple[Tensor, Tensor]
"""States (m, s) and the actions done in them (m, a)."""


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
        self.optimizer = torch.optim.Adam(self.parameters(), config.learning_rate, fused=True)

    def logits(self, state: Tensor, *actions: Tensor) -> list[Tensor]:
        """Logit of D for each of ``actions`` (…, a) in ``state`` (…, s), each (…,)."""
        base = self.state(state)
        results = []
        for action in actions:
            logit = self.head(base + self.action(action))[..., 0]
            results.append(torch.tanh(logit) if self.config.logit_bound == "tanh" else logit)
        return results

    def fit(
        self,
        victim: Pairs,
        imitator: Pairs,
        passes: tuple[int, int],
        generator: torch.Generator,
    ) -> float:
        """Descend the cross-entropy, label 1 for the victim; returns its mean, the penalty not included.

        Args:
            victim: the victim's states and actions.
            imitator: the imitator's, as many rows or fewer; with the same states (the same tensor object)
                the state layer is evaluated once for both.
            passes: epochs and minibatches.
            generator: shuffles, and draws the points of the gradient penalty.
        """
        losses = []
        shared = victim[0] is imitator[0]
        for i, rows in enumerate(batches(len(imitator[0]), *passes, generator)):
            states, actions = victim[0].index_select(0, rows), victim[1][rows]
            others = states if shared else imitator[0].index_select(0, rows)
            drawn = imitator[1][rows]
            if shared:
                real, fake = self.logits(states, actions, drawn)
            else:
                (real,), (fake,) = self.logits(states, actions), self.logits(others, drawn)
            loss = imitation_loss(real, fake)
            losses.append(loss.detach())
            if self.config.gradient_penalty and i % _PENALTY_EVERY == 0:
                penalty = self._penalty((states, actions), (others, drawn), generator)
                loss = loss + _PENALTY_EVERY * penalty
            self.optimizer.zero_grad()
            loss.backward()
            self.optimizer.step()
        return float(torch.stack(losses).mean())

    def _penalty(self, real: Pairs, fake: Pairs, generator: torch.Generator) -> Tensor:
        """Weighted mean squared gradient of the logit by the action, at random points between both, ()."""
        share = torch.rand(len(real[0]), 1, generator=generator, device=generator.device)
        states, actions = (a + share * (b - a) for a, b in zip(real, fake, strict=True))
        actions.requires_grad_()
        (logit,) = self.logits(states, actions)
        (slope,) = torch.autograd.grad(logit.sum(), actions, create_graph=True)
        return self.config.gradient_penalty * slope.square().sum(-1).mean()


def _initialise(layers: Sequence[nn.Linear]) -> None:
    for layer in layers:
        nn.init.orthogonal_(layer.weight, gain=1.0 if layer is layers[-1] else math.sqrt(2))
        nn.init.zeros_(layer.bias)


def imitation_loss(victim_logits: Tensor, imitator_logits: Tensor) -> Tensor:
    """Binary cross-entropy, label 1 for the victim, 0 for the imitator (docs/methods.md §2).

    The paper states min over D of the log-likelihoods, which moves D in the same direction but has its
    optimum at the bounds; GAIL minimises the cross-entropy (Ho & Ermon 2016, algorithm 1).
    """
    return F.softplus(-victim_logits).mean() + F.softplus(imitator_logits).mean()


def reward_logit(logits: Tensor) -> Tensor:
    """log D − log(1 − D), the logit itself, shape unchanged; of either sign (Kostrikov et al. 2019)."""
    return logits


def reward_log_d(logits: Tensor) -> Tensor:
    """log D, shape unchanged; in (−∞, 0)."""
    return F.logsigmoid(logits)


def reward_neg_log_1md(logits: Tensor) -> Tensor:
    """−log(1 − D), shape unchanged; in (0, ∞)."""
    return F.softplus(logits)


REWARDS = {"log_d": reward_log_d, "neg_log_1md": reward_neg_log_1md, "logit": reward_logit}
"""``options.apil.reward`` → the imitator's reward from D's logits."""
