"""Which policies can be trained on, and how: their weights in the one form that training and files share.

Zoo agents, students and plain adversaries are all the same body: standardised observation, at most a ReLU
layer and an LSTM, tanh layers, a linear one (:class:`StudentShape`). So a hardened victim's file is a
student's file, and needs no code of its own to play.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from apil_core.api.policy import Policy
from apil_core.api.types import OWN_GROUP
from apil_core.common.errors import VictimError
from apil_core.policies.student_policy import StudentPolicy, StudentShape, Weights
from apil_core.policies.zoo_networks import LstmNetwork, MlpNetwork, Network
from apil_core.policies.zoo_policy import ZooPolicy
from apil_core.training.adversary import AdversaryPolicy
from apil_core.training.normalize import ObservationNormalizer

TRAINABLE = (
    "zoo:…, embedded:…, retrained:DIR, a student's safetensors:FILE, "
    "or run:DIR of a method without extra observations (adrl, apl)"
)
"""Names of what :func:`trainable` takes."""


@dataclass(frozen=True)
class StoredCritic:
    """A value network that came with the victim.

    Attributes:
        shape, weights: of the network; it gives normalised returns.
        mean, deviation: of the returns it was trained on: ``return = deviation · value + mean``.
    """

    shape: StudentShape
    weights: Weights
    mean: float
    deviation: float


@dataclass(frozen=True)
class Trainable:
    """A policy in parts.

    Attributes:
        shape, weights: of the policy, named as in a student's file, float32, on the CPU.
        critic: its value network, if it has one.
    """

    shape: StudentShape
    weights: Weights
    critic: StoredCritic | None = None


def trainable(policy: Policy) -> Trainable:
    """The parts of a policy.

    Raises:
        VictimError: it is none that can be trained.
    """
    if isinstance(policy, ZooPolicy):
        return _of_zoo(policy)
    if isinstance(policy, StudentPolicy):
        return Trainable(policy.shape, {name: tensor.cpu() for name, tensor in policy.weights.items()})
    if isinstance(policy, AdversaryPolicy) and list(policy.builder.sizes) == [OWN_GROUP]:
        return _of_adversary(policy)
    raise VictimError(f"{policy.info.name} cannot be retrained; what can: {TRAINABLE}")


def _of_zoo(policy: ZooPolicy) -> Trainable:
    info, filters = policy.info, policy.observation_filter
    statistics = {"observation.mean": filters.mean, "observation.std": filters.deviation}
    shape, layers = _network(policy.actor, info.observation_size, info.action_size, policy.CLIP)
    critic_shape, critic = _network(policy.critic, info.observation_size, 1, policy.CLIP)
    returns = policy.return_filter
    stored = StoredCritic(critic_shape, critic, float(returns.mean), float(returns.deviation))
    return Trainable(shape, _plain({**statistics, "log_std": policy.logstd, **layers}), stored)


def _network(
    network: Network, observation_size: int, outputs: int, clip: float
) -> tuple[StudentShape, dict[str, Tensor]]:
    if isinstance(network, LstmNetwork):
        layers = {"embed": network.embed, "mlp.0": network.out}
        weights = {**_linears(layers), **_gates(network)}
        shape = StudentShape(
            "lstm", observation_size, outputs, network.width, (), clip, network.embed.out_features
        )
        return shape, _plain(weights)
    assert isinstance(network, MlpNetwork)
    stack = (network.hidden_0, network.hidden_1, network.out)
    hidden = tuple(layer.out_features for layer in stack[:-1])
    shape = StudentShape("mlp", observation_size, outputs, 0, hidden, clip)
    return shape, _plain(_linears({f"mlp.{i}": layer for i, layer in enumerate(stack)}))


def _linears(layers: dict[str, nn.Linear]) -> dict[str, Tensor]:
    weights = {f"{name}.weight": layer.weight for name, layer in layers.items()}
    return weights | {f"{name}.bias": layer.bias for name, layer in layers.items()}


def _gates(network: LstmNetwork) -> dict[str, Tensor]:
    """One product over [x; h] with gates i, f, o, j → torch's two, with gates i, f, j, o."""
    i, f, o, j = network.lstm.weight.chunk(4)
    weight = torch.cat((i, f, j, o))
    i, f, o, j = network.lstm.bias.chunk(4)
    bias = torch.cat((i, f, j, o))
    inputs = network.embed.out_features
    return {
        "rnn.weight_ih": weight[:, :inputs],
        "rnn.weight_hh": weight[:, inputs:],
        "rnn.bias_ih": bias,
        "rnn.bias_hh": torch.zeros_like(bias),
    }


def _of_adversary(policy: AdversaryPolicy) -> Trainable:
    normalizer = policy.builder.normalizers[OWN_GROUP]
    assert isinstance(normalizer, ObservationNormalizer)
    linears = [layer for layer in policy.actor.model.mlp if isinstance(layer, nn.Linear)]
    hidden = tuple(layer.out_features for layer in linears[:-1])
    info = policy.info
    weights = {
        "observation.mean": normalizer.shift,
        "observation.std": 1 / normalizer.scale,
        "log_std": policy.actor.std.log(),
        **_linears({f"mlp.{i}": layer for i, layer in enumerate(linears)}),
    }
    for name in ("weight", "bias"):
        weights[f"mlp.{len(hidden)}.{name}"] = weights[f"mlp.{len(hidden)}.{name}"] * policy.actor.unit
    shape = StudentShape("mlp", info.observation_size, info.action_size, 0, hidden, normalizer.clip)
    return Trainable(shape, _plain(weights))


def _plain(weights: Weights) -> dict[str, Tensor]:
    return {name: tensor.detach().cpu().float().clone() for name, tensor in weights.items()}
