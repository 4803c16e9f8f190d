"""Policies that can be retrained: their weights in the one form that training and files share.

Zoo agents, students and plain adversaries are all the same body: standardised observation, at most a ReLU
layer and an LSTM, tanh layers, a linear one (:class:`NetworkShape`). So a hardened victim's file is a
student's file, and needs no code of its own to play.
"""

from __future__ import annotations

from torch import nn

from apil_core.api.policy import Policy
from apil_core.api.types import OWN_GROUP
from apil_core.common.errors import VictimError
from apil_core.policies.frozen_policy import FrozenPolicy
from apil_core.policies.network import NetworkShape
from apil_core.training.adversary import AdversaryPolicy
from apil_core.training.normalize import ObservationNormalizer

LINEAR = ("weight", "bias")
TRAINABLE = (
    "zoo:…, embedded:…, retrained:DIR, a student's safetensors:FILE, "
    "or run:DIR of a method without extra observations (adrl, apl)"
)
"""Policy names that :func:`trainable` accepts."""


def trainable(policy: Policy) -> FrozenPolicy:
    """Return a policy in that form; itself if it has it.

    Raises:
        VictimError: it is none that can be trained.
    """
    if isinstance(policy, FrozenPolicy):
        return policy
    if isinstance(policy, AdversaryPolicy) and list(policy.builder.sizes) == [OWN_GROUP]:
        return _of_adversary(policy)
    raise VictimError(f"{policy.info.name} cannot be retrained; what can: {TRAINABLE}")


def _of_adversary(policy: AdversaryPolicy) -> FrozenPolicy:
    normalizer = policy.builder.normalizers[OWN_GROUP]
    assert isinstance(normalizer, ObservationNormalizer)
    linears = [layer for layer in policy.actor.model.mlp if isinstance(layer, nn.Linear)]
    hidden = tuple(layer.out_features for layer in linears[:-1])
    info = policy.info
    weights = {
        "observation.mean": normalizer.shift,
        "observation.std": 1 / normalizer.scale,
        "log_std": policy.actor.std.log(),
        **{f"mlp.{i}.{name}": getattr(layer, name) for i, layer in enumerate(linears) for name in LINEAR},
    }
    for name in LINEAR:
        weights[f"mlp.{len(hidden)}.{name}"] = weights[f"mlp.{len(hidden)}.{name}"] * policy.actor.unit
    shape = NetworkShape("mlp", info.observation_size, info.action_size, 0, hidden, normalizer.clip)
    return FrozenPolicy(info, shape, {name: tensor.detach().float() for name, tensor in weights.items()})
