"""The actors of Stable-Baselines3's ``MlpPolicy``, rebuilt from their weights' names and shapes."""

from __future__ import annotations

import re
from collections.abc import Mapping

import torch
from torch import Tensor, nn

from apil_core.api.policy import Policy, PolicyInfo
from apil_core.api.types import Decision, DiagonalGaussian, View
from apil_core.common.errors import VictimError

Weights = Mapping[str, Tensor]

_ACTIVATIONS = {kind.__name__: kind for kind in (nn.Tanh, nn.ReLU, nn.ELU, nn.LeakyReLU, nn.SiLU, nn.GELU)}
_UNSUPPORTED = {
    "features_extractor.": "a features extractor (CnnPolicy, MultiInputPolicy)",
    "lstm": "a recurrent policy",
    "running_mean": "batch normalisation",
}
_LOG_STD = (-20.0, 2.0)
"""SAC's bounds of the log standard deviation."""


def make_policy(info: PolicyInfo, weights: Weights, activation: str | None) -> Policy:
    """The policy whose weights these are; its algorithm is told by their names.

    Args:
        info: with sizes and action bounds.
        weights: ``policy.pth``.
        activation: between layers; ``None``: what the algorithm takes if not told otherwise.

    Raises:
        VictimError: no supported agent has such weights.
    """
    for part, what in _UNSUPPORTED.items():
        if any(part in name for name in weights):
            raise VictimError(f"{info.name}: {what} is not supported; MlpPolicy is")
    if "action_net.weight" in weights and "log_std" in weights:
        body = _body(info, weights, "mlp_extractor.policy_net.", "action_net", activation or "Tanh")
        return GaussianAgent(info, body, weights["log_std"].float())
    if "actor.latent_pi.0.weight" in weights or "actor.log_std.weight" in weights:
        body = _body(info, weights, "actor.latent_pi.", "actor.mu", activation or "ReLU")
        head = _linear(info, weights, "actor.log_std", weights["actor.mu.weight"].shape[1])
        return SquashedAgent(info, body, head)
    if any(re.fullmatch(r"actor\.mu\.\d+\.weight", name) for name in weights):
        return SquashedAgent(info, _body(info, weights, "actor.mu.", None, activation or "ReLU"), None)
    raise VictimError(
        f"{info.name}: expected the weights of PPO, A2C, SAC, TD3 or DDPG with MlpPolicy and continuous "
        f"actions, found {', '.join(sorted(weights)[:4])}, …"
    )


def _body(
    info: PolicyInfo, weights: Weights, prefix: str, head: str | None, activation: str
) -> nn.Sequential:
    """Linear layers ``<prefix><number>`` in order of their numbers, then ``head``; activations between."""
    if activation not in _ACTIVATIONS:
        known = ", ".join(sorted(_ACTIVATIONS))
        raise VictimError(f"{info.name}: activation {activation} is not supported (known: {known})")
    pattern = re.compile(rf"{re.escape(prefix)}(\d+)\.weight")
    numbered = {int(found.group(1)): name for name in weights if (found := pattern.fullmatch(name))}
    names = [numbered[number].removesuffix(".weight") for number in sorted(numbered)]
    layers: list[nn.Module] = []
    width = info.observation_size
    for name in [*names, *([head] if head else [])]:
        linear = _linear(info, weights, name, width)
        layers += [linear, _ACTIVATIONS[activation]()]
        width = linear.out_features
    if width != info.action_size:
        raise VictimError(f"{info.name}: expected {info.action_size} actions, its last layer gives {width}")
    return nn.Sequential(*layers[:-1])


def _linear(info: PolicyInfo, weights: Weights, name: str, inputs: int) -> nn.Linear:
    weight, bias = weights.get(f"{name}.weight"), weights.get(f"{name}.bias")
    if weight is None or bias is None or weight.ndim != 2 or weight.shape[1] != inputs:
        found = "none" if weight is None or bias is None else f"{tuple(weight.shape)}"
        raise VictimError(
            f"{info.name}: layer {name}: expected weights (k, {inputs}) and bias, found {found}"
        )
    layer = nn.Linear(inputs, len(weight), device="meta")  # no random initialisation: it would cost a draw
    layer.weight = nn.Parameter(weight.float(), requires_grad=False)
    layer.bias = nn.Parameter(bias.float(), requires_grad=False)
    return layer


class GaussianAgent(Policy):
    """PPO's and A2C's actor: a Gaussian whose spread does not depend on the observation."""

    def __init__(self, info: PolicyInfo, body: nn.Sequential, log_std: Tensor):
        if log_std.shape != (info.action_size,):
            found = tuple(log_std.shape)
            raise VictimError(f"{info.name}: expected log_std ({info.action_size},), found {found}")
        self.info = info
        self._body = body
        self._std = log_std.exp()

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
        distribution = DiagonalGaussian(self._body[-1](hidden), self._std)
        action = distribution.sample(generator) if sample else distribution.mean
        return Decision(action, distribution, {"hidden": hidden} if activations else None)

    def to(self, device: torch.device | str) -> GaussianAgent:
        """Move the weights; returns self."""
        self._body.to(device)
        self._std = self._std.to(device)
        return self


class SquashedAgent(Policy):
    """SAC's, TD3's and DDPG's actor: ends in a tanh that is stretched to the action bounds.

    SAC draws before the tanh; the others have nothing to draw. Either way there is no Gaussian of the
    action itself, so a decision carries no distribution.
    """

    def __init__(self, info: PolicyInfo, body: nn.Sequential, log_std: nn.Linear | None):
        assert info.action_bounds is not None
        self.info = info
        self._body = body
        self._log_std = log_std
        self._low, self._high = info.action_bounds

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
        raw = self._body[-1](hidden)
        if sample and self._log_std is not None:
            raw = DiagonalGaussian(raw, self._log_std(hidden).clamp(*_LOG_STD).exp()).sample(generator)
        action = self._low + 0.5 * (raw.tanh() + 1) * (self._high - self._low)
        return Decision(action, None, {"hidden": hidden} if activations else None)

    def to(self, device: torch.device | str) -> SquashedAgent:
        """Move the weights; returns self."""
        for network in (self._body, self._log_std):
            if network is not None:
                network.to(device)
        return self
