"""Baseline agents that ignore observations, as a lower bound: random actions, and no motion."""

from __future__ import annotations

import hashlib
import re

import torch

from apil_core.api.policy import Policy, PolicyInfo
from apil_core.api.types import Decision, DiagonalGaussian, View
from apil_core.common.errors import VictimError

_NAME = re.compile(r"(?P<kind>random|zero)/(?P<observation>[1-9]\d{0,5})x(?P<action>[1-9]\d{0,5})")


class NoisePolicy(Policy):
    """Standard normal actions, independent of what is seen; the mode is zero."""

    def __init__(self, info: PolicyInfo):
        self.info = info
        self._std = torch.ones(info.action_size)

    def act(
        self,
        view: View,
        *,
        sample: bool,
        generator: torch.Generator | None = None,
        activations: bool = False,
    ) -> Decision:
        """See :meth:`apil_core.Policy.act`; there are no hidden layers to return."""
        mean = view.own.new_zeros(len(view.own), self.info.action_size)
        distribution = DiagonalGaussian(mean, self._std.to(mean.device))
        action = distribution.sample(generator) if sample else mean
        return Decision(action, distribution, {} if activations else None)


class ZeroPolicy(NoisePolicy):
    """Always the zero action; no distribution, as a point mass has no density."""

    def act(
        self,
        view: View,
        *,
        sample: bool,
        generator: torch.Generator | None = None,
        activations: bool = False,
    ) -> Decision:
        """See :meth:`apil_core.Policy.act`; ``sample`` changes nothing."""
        decision = super().act(view, sample=False, activations=activations)
        return Decision(decision.action, None, decision.activations)


def load(name: str) -> Policy:
    """A baseline by its name without scheme, e.g. ``"random/384x17"``.

    Raises:
        VictimError: the name has another form.
    """
    match = _NAME.fullmatch(name)
    if match is None:
        raise VictimError(
            f"unknown victim 'baseline:{name}' (known: random/OxA, zero/OxA, e.g. random/384x17)"
        )
    info = PolicyInfo(
        name=f"baseline:{name}",
        sha256=hashlib.sha256(name.encode()).hexdigest(),  # there are no weights: the name is all
        observation_size=int(match["observation"]),
        action_size=int(match["action"]),
        provenance={"repository": "built in"},
    )
    return ZeroPolicy(info) if match["kind"] == "zero" else NoisePolicy(info)
