"""Tensors exchanged between games, policies and hooks. ``n`` is ``num_envs``, ``T`` the rollout length.

``α`` is the adversary (trained), ``ν`` the victim (frozen), as in the papers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any, Literal

import torch
from torch import Tensor

if TYPE_CHECKING:
    from apil_core.api.game import SideLayout

Mode = Literal["train", "eval"]
Role = Literal["adversary", "victim", "imitator"]

OWN_GROUP = "own"
"""Name of the adversary's own observation among the observation groups."""

PRIVILEGED_GROUP = "privileged"
"""Name of the observation group for critics only, which are not needed after training."""


@dataclass
class DiagonalGaussian:
    """A batch of independent normal distributions.

    Attributes:
        mean: shape (..., k).
        std: shape (..., k) or (k,), positive.
    """

    mean: Tensor
    std: Tensor

    def sample(self, generator: torch.Generator | None = None) -> Tensor:
        """One draw, shape (..., k)."""
        noise = torch.randn(
            self.mean.shape, generator=generator, device=self.mean.device, dtype=self.mean.dtype
        )
        return self.mean + self.std * noise

    def log_prob(self, value: Tensor) -> Tensor:
        """Log density in nats, summed over the last axis, shape (...,)."""
        z = (value - self.mean) / self.std
        return (-0.5 * (z.square() + math.log(2 * math.pi)) - self.std.log()).sum(-1)

    def kl(self, other: DiagonalGaussian) -> Tensor:
        """KL(self ‖ other) in nats, summed over the last axis, shape (...,)."""
        ratio = (self.std / other.std).square()
        shift = ((self.mean - other.mean) / other.std).square()
        return 0.5 * (ratio + shift - 1 - ratio.log()).sum(-1)

    def entropy(self) -> Tensor:
        """Differential entropy in nats, shape (...,)."""
        return (self.std.log() + 0.5 * math.log(2 * math.pi * math.e)).expand_as(self.mean).sum(-1)


@dataclass
class Context:
    """The side an observation is made for, without any reference to a run.

    Attributes:
        side: index of the side that will see the observation.
        role: adversary or victim.
        seat: that side's observation and action sizes, and the channels that depend on its opponent.
        mode: ``train`` or ``eval``; stochastic helpers may differ (see docs/methods.md §3, row ã).
        device: of the tensors.
        generator: the only source of randomness a hook may use.
    """

    side: int
    role: Role
    seat: SideLayout
    mode: Mode
    device: torch.device
    generator: torch.Generator


@dataclass
class View:
    """Inputs of a policy for one action.

    Attributes:
        own: own observation, shape (n, o).
        opponent: the other side's observation, shape (n, o').
        first: shape (n,), bool, true where a new game starts with this observation.
        opponent_action: the action the opponent has already chosen for this step, shape (n, a'),
            or ``None`` where it has not. Only the oracle ablation should read it.
    """

    own: Tensor
    opponent: Tensor
    first: Tensor
    opponent_action: Tensor | None = None


@dataclass
class Decision:
    """Output of a policy.

    Attributes:
        action: shape (n, a), not clipped.
        distribution: what it was drawn from, or ``None`` for a black box.
        activations: named inner layers, each (n, k), when asked for.
    """

    action: Tensor
    distribution: DiagonalGaussian | None = None
    activations: dict[str, Tensor] | None = None


@dataclass
class StepBatch:
    """One step of all games, for hooks. Valid during the hook call only; do not modify.

    Attributes:
        observation: the adversary's observation s^α_t, before the step, after filters, shape (n, o).
        victim_observation: s^ν_t, shape (n, o').
        action, victim_action: a^α_t and a^ν_t as chosen (unclipped), (n, a) and (n, a').
        victim_distribution: what a^ν_t was drawn from, or ``None`` for a black box.
        reward, victim_reward: r^α and r^ν in the units of docs/methods.md §1, shape (n,).
        normalized_reward, normalized_victim_reward: each divided by the running standard
            deviation of its own discounted return, clipped to ±10, shape (n,).
        sparse, dense: per role, shape (2, n): row 0 adversary, row 1 victim.
        first: shape (n,), bool: s_t is a game's first.
        done: shape (n,), bool: the game ended with this step; the next one's observation is a new game's.
        outcome: shape (n,), int8: +1 adversary won, −1 victim won, 0 tie; only where ``done``.
        cause: shape (n,), int8: index into ``GameLayout.causes``; only where ``done``.
    """

    observation: Tensor
    victim_observation: Tensor
    action: Tensor
    victim_action: Tensor
    victim_distribution: DiagonalGaussian | None
    reward: Tensor
    victim_reward: Tensor
    normalized_reward: Tensor
    normalized_victim_reward: Tensor
    sparse: Tensor
    dense: Tensor
    first: Tensor
    done: Tensor
    outcome: Tensor
    cause: Tensor


@dataclass
class Rollout:
    """One iteration's transitions, time first. Buffers are reused: copy what must outlive the iteration.

    Where ``done[t]``, the observation of step t + 1, and after the last step ``next_observation``, is the
    first of the next game; the last of the ended game is only in ``successors``. Time-outs are ends, too.

    Attributes:
        observation: s^α, shape (T, n, o), after filters, before normalisation.
        victim_observation: s^ν, shape (T, n, o').
        next_observation, next_victim_observation: after the last step, (n, o) and (n, o').
        action, victim_action: shape (T, n, a), (T, n, a').
        victim_mean, victim_std: of the victim's distribution, (T, n, a'), or ``None`` for a black box.
        reward, victim_reward, normalized_reward, normalized_victim_reward: shape (T, n).
        shaped_reward: what the learner gets: normalised sum of ``reward`` and all terms, or what
            ``relabel_reward`` made of the sum, (T, n).
        first, done: shape (T, n), bool.
        groups: extra observation groups as given by ``extend_observation``, each (T, n, k).
        next_groups: the same for the observation after the last step, each (n, k).
        advantages: shape (T, n); set before ``update_auxiliary``.
        action_mean, action_std: of the adversary's distribution that ``action`` was drawn from, (T, n, a);
            ``None`` in the rollouts of ``run.collect``.
        successors, victim_successors: s^α and s^ν after each step, (T, n, o) and (T, n, o'): the next
            observation, or where ``done`` the ended game's last, before the reset and without filters.
            ``None`` unless a hook of the run takes the argument of that name, and in ``run.collect``.
    """

    observation: Tensor
    victim_observation: Tensor
    next_observation: Tensor
    next_victim_observation: Tensor
    action: Tensor
    victim_action: Tensor
    victim_mean: Tensor | None
    victim_std: Tensor | None
    reward: Tensor
    victim_reward: Tensor
    normalized_reward: Tensor
    normalized_victim_reward: Tensor
    shaped_reward: Tensor
    first: Tensor
    done: Tensor
    groups: dict[str, Tensor] = field(default_factory=dict)
    next_groups: dict[str, Tensor] = field(default_factory=dict)
    advantages: Tensor | None = None
    action_mean: Tensor | None = None
    action_std: Tensor | None = None
    successors: Tensor | None = None
    victim_successors: Tensor | None = None

    def after(self, step: int) -> Rollout:
        """The rollout without its first ``step`` steps; views of the same memory."""
        kept: dict[str, Any] = {}
        for item in fields(self):
            value = getattr(self, item.name)
            if isinstance(value, Tensor) and not item.name.startswith("next_"):
                kept[item.name] = value[step:]
        return replace(self, **kept, groups={name: value[step:] for name, value in self.groups.items()})

    @property
    def steps(self) -> int:
        """Environment steps in this rollout, ``T * n``."""
        return self.done.numel()
