"""The actors of Stable-Baselines3's ``MlpPolicy``, rebuilt from the names and shapes of their weights."""

from __future__ import annotations

import math
import re
from abc import abstractmethod
from collections.abc import Mapping
from typing import NamedTuple

import torch
from torch import Tensor, nn

from apil_core.api.policy import Policy, PolicyInfo
from apil_core.api.types import Decision, DiagonalGaussian, View
from apil_core.common.errors import VictimError

Weights = Mapping[str, Tensor]

_ACTIVATIONS = {kind.__name__: kind for kind in (nn.Tanh, nn.ReLU, nn.ELU, nn.LeakyReLU, nn.SiLU, nn.GELU)}
_LOG_STD = (-20.0, 2.0)
"""SAC's and TQC's bounds of the log standard deviation."""


class Layers(NamedTuple):
    """Names of an actor's linear layers in ``policy.pth``.

    Attributes:
        hidden: prefixes of numbered layers, in order.
        head: the last layer, or ``None``: the last of the numbered ones.
        activation: between them, by default.
    """

    hidden: tuple[str, ...]
    head: str | None
    activation: str


ARS = "sb3_contrib.ars.policies"
_PPO = "stable_baselines3.common.policies"  # and A2C, TRPO
_SAC = Layers(("actor.latent_pi.",), "actor.mu", "ReLU")
KNOWN = {
    _PPO: Layers(("mlp_extractor.shared_net.", "mlp_extractor.policy_net."), "action_net", "Tanh"),
    "stable_baselines3.sac.policies": _SAC,
    "stable_baselines3.td3.policies": Layers(("actor.mu.",), None, "ReLU"),  # and DDPG
    "stable_baselines3.dqn.policies": Layers(("q_net.q_net.",), None, "ReLU"),
    "sb3_contrib.tqc.policies": _SAC,
    "sb3_contrib.qrdqn.policies": Layers(("quantile_net.quantile_net.",), None, "ReLU"),
    ARS: Layers(("action_net.",), None, "ReLU"),
}
"""By the module of the policy's class."""
_NO_ACTOR = re.compile(r"(mlp_extractor\.)?value_net\.|critic\.|\w+_target\.")
"""Weights that acting does not need."""


def make_policy(
    info: PolicyInfo, weights: Weights, module: str, activation: str | None, *, squashes: bool
) -> Policy:
    """The policy whose weights these are.

    Args:
        info: with sizes and action bounds.
        weights: ``policy.pth``.
        module: of the policy's class, one of :data:`KNOWN`.
        activation: between layers; ``None``: the algorithm's default.
        squashes: True if ARS's actions end in a tanh.

    Raises:
        VictimError: these are not the weights of such a policy, or not all of its actor's are used.
    """
    layers, unused = KNOWN[module], dict(weights)
    body = _body(info, unused, layers, activation or layers.activation)
    log_std = unused.pop("log_std", torch.empty(0)) if module == _PPO else None
    head = None
    if layers is _SAC:
        head = _linear(info, unused, "actor.log_std", weights["actor.mu.weight"].shape[1])
    if left := [name for name in unused if not _NO_ACTOR.match(name)]:
        raise VictimError(
            f"{info.name}: expected the layers of MlpPolicy only, found {', '.join(sorted(left)[:4])} besides"
        )
    if info.action_bounds and math.isinf(info.action_bounds[1]):
        return ScoresAgent(info, body, drawn=module == _PPO)
    if layers is _SAC or module.startswith("stable_baselines3.td3") or squashes:
        return SquashedAgent(info, body, head)
    return GaussianAgent(info, body, log_std)


def _body(info: PolicyInfo, weights: dict[str, Tensor], layers: Layers, activation: str) -> nn.Sequential:
    """Linear layers in order, activations between; takes them out of ``weights``."""
    if activation not in _ACTIVATIONS:
        known = ", ".join(sorted(_ACTIVATIONS))
        raise VictimError(f"{info.name}: activation {activation} is not supported (known: {known})")
    names = []
    for prefix in layers.hidden:
        pattern = re.compile(rf"{re.escape(prefix)}(\d+)\.weight")
        numbered = {int(found.group(1)): name for name in weights if (found := pattern.fullmatch(name))}
        names += [numbered[number].removesuffix(".weight") for number in sorted(numbered)]
    body: list[nn.Module] = []
    width = info.observation_size
    for name in [*names, *([layers.head] if layers.head else [])]:
        linear = _linear(info, weights, name, width)
        body += [linear, _ACTIVATIONS[activation]()]
        width = linear.out_features
    quantiles = width // info.action_size if "quantile" in layers.hidden[0] else 1
    if not body or width != quantiles * info.action_size:
        raise VictimError(f"{info.name}: expected {info.action_size} actions, its last layer gives {width}")
    return nn.Sequential(*body[:-1])


def _linear(info: PolicyInfo, weights: dict[str, Tensor], name: str, inputs: int) -> nn.Linear:
    weight, bias = weights.pop(f"{name}.weight", None), weights.pop(f"{name}.bias", None)
    if weight is None or weight.ndim != 2 or weight.shape[1] != inputs:
        found = "none" if weight is None else f"{tuple(weight.shape)}"
        raise VictimError(f"{info.name}: layer {name}: expected weights (k, {inputs}), found {found}")
    if bias is not None and bias.shape != weight.shape[:1]:
        raise VictimError(
            f"{info.name}: layer {name}: expected bias ({len(weight)},), found {tuple(bias.shape)}"
        )
    layer = nn.Linear(inputs, len(weight), bias is not None, device="meta")  # meta: no random draw is made
    layer.weight = nn.Parameter(weight.float(), requires_grad=False)
    if bias is not None:
        layer.bias = nn.Parameter(bias.float(), requires_grad=False)
    return layer


class _Agent(Policy):
    """An MLP; subclasses interpret its output."""

    def __init__(self, info: PolicyInfo, body: nn.Sequential):
        self.info = info
        self._body = body

    @torch.no_grad()
    def act(
        self,
        view: View,
        *,
        sample: bool,
        generator: torch.Generator | None = None,
        activations: bool = False,
    ) -> Decision:
        """See :meth:`apil_core.Policy.act`."""
        hidden = self._body[:-1](view.own)
        action, distribution = self._decide(self._body[-1](hidden), hidden, sample, generator)
        return Decision(action, distribution, {"hidden": hidden} if activations else None)

    @abstractmethod
    def _decide(
        self, output: Tensor, hidden: Tensor, sample: bool, generator: torch.Generator | None
    ) -> tuple[Tensor, DiagonalGaussian | None]:
        """Actions, and their distribution if it is a Gaussian."""

    def to(self, device: torch.device | str) -> _Agent:
        """Move the weights; returns self."""
        self._body.to(device)
        return self


class GaussianAgent(_Agent):
    """PPO's and A2C's actor: a Gaussian with state-independent standard deviation; ARS's has none."""

    def __init__(self, info: PolicyInfo, body: nn.Sequential, log_std: Tensor | None):
        super().__init__(info, body)
        if log_std is not None and log_std.shape != (info.action_size,):
            found = tuple(log_std.shape)
            raise VictimError(f"{info.name}: expected log_std ({info.action_size},), found {found}")
        self._std = None if log_std is None else log_std.float().exp()

    def _decide(
        self, output: Tensor, hidden: Tensor, sample: bool, generator: torch.Generator | None
    ) -> tuple[Tensor, DiagonalGaussian | None]:
        if self._std is None:
            return output, None
        distribution = DiagonalGaussian(output, self._std.to(output.device))
        return (distribution.sample(generator) if sample else output), distribution


class SquashedAgent(_Agent):
    """SAC's, TQC's, TD3's, DDPG's and ARS's actor: ends in a tanh that is scaled to the action bounds.

    SAC and TQC sample before the tanh; the others are deterministic. In both cases the action itself is not
    Gaussian, so a decision has no distribution.
    """

    def __init__(self, info: PolicyInfo, body: nn.Sequential, log_std: nn.Linear | None):
        super().__init__(info, body)
        assert info.action_bounds is not None
        self._log_std = log_std
        self._low, self._high = info.action_bounds

    def _decide(
        self, output: Tensor, hidden: Tensor, sample: bool, generator: torch.Generator | None
    ) -> tuple[Tensor, DiagonalGaussian | None]:
        if sample and self._log_std is not None:
            std = self._log_std(hidden).clamp(*_LOG_STD).exp()
            output = DiagonalGaussian(output, std).sample(generator)
        return self._low + 0.5 * (output.tanh() + 1) * (self._high - self._low), None

    def to(self, device: torch.device | str) -> _Agent:
        """Move the weights; returns self."""
        if self._log_std is not None:
            self._log_std.to(device)
        return super().to(device)


class ScoresAgent(_Agent):
    """An actor with discrete actions: scores, of which the game takes the largest.

    PPO's and A2C's are logits, sampled by adding Gumbel noise; DQN, QR-DQN (the mean of its quantiles) and
    ARS take the best.
    """

    def __init__(self, info: PolicyInfo, body: nn.Sequential, *, drawn: bool):
        super().__init__(info, body)
        self._drawn = drawn

    def _decide(
        self, output: Tensor, hidden: Tensor, sample: bool, generator: torch.Generator | None
    ) -> tuple[Tensor, DiagonalGaussian | None]:
        scores = output.unflatten(1, (-1, self.info.action_size)).mean(1)
        if not (sample and self._drawn):
            return scores, None
        noise = torch.empty_like(scores).exponential_(generator=generator).log()
        return scores - noise, None
