"""Scripted victims, not trained; loaded under the scheme ``scripted``."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path

import torch
from torch import Tensor

from apil_core import Decision, DiagonalGaussian, Policy, PolicyInfo, PolicyListing, UnknownNameError, View

PROVENANCE = {"kind": "scripted", "source": "apil_envs/scripted.py"}


def source_hash() -> str:
    """SHA-256 of this file, which takes the place of weights."""
    return hashlib.sha256(Path(__file__).read_bytes()).hexdigest()


class ToyEvader(Policy):
    """Runs for the gate and swerves when the pursuer is near, always to its own left: an exploitable bias."""

    STD = 0.3
    ALERT = 0.45  # distance at which it starts to swerve, disc radii
    SWERVE = 2.0
    RETREAT = 0.8

    def __init__(self) -> None:
        name = "scripted:toy-pursuit/evader/v1"
        self.info = PolicyInfo(name, source_hash(), observation_size=7, action_size=2, provenance=PROVENANCE)
        self._std = torch.full((2,), self.STD)

    def mean(self, observation: Tensor) -> Tensor:
        """Mean action, (n, 2), a fixed function of the observation (n, 7) of toy-pursuit."""
        to_pursuer, to_gate = observation[:, 2:4], observation[:, 4:6]
        distance = to_pursuer.norm(dim=1, keepdim=True).clamp_min(1e-6)
        run = to_gate / to_gate.norm(dim=1, keepdim=True).clamp_min(1e-6)
        towards = to_pursuer / distance
        left = torch.stack([-towards[:, 1], towards[:, 0]], dim=1)
        alarm = (1 - distance / self.ALERT).clamp_min(0)
        wish = run + alarm * (self.SWERVE * left - self.RETREAT * towards)
        return wish / wish.norm(dim=1, keepdim=True).clamp_min(1e-6)

    def act(
        self,
        view: View,
        *,
        sample: bool,
        generator: torch.Generator | None = None,
        activations: bool = False,
    ) -> Decision:
        """See :class:`apil_core.Policy`; its only activation is the mean itself."""
        mean = self.mean(view.own)
        distribution = DiagonalGaussian(mean, self._std)
        action = distribution.sample(generator) if sample else mean
        return Decision(action, distribution, {"hidden": mean} if activations else None)

    def to(self, device: torch.device | str) -> ToyEvader:
        """See :class:`apil_core.Policy`."""
        self._std = self._std.to(device)
        return self


_SCRIPTS: dict[str, Callable[[], Policy]] = {"toy-pursuit/evader/v1": ToyEvader}


def load_scripted(name: str) -> Policy:
    """The scripted policy of that name (without ``scripted:``).

    Raises:
        UnknownNameError: there is none.
    """
    if name not in _SCRIPTS:
        raise UnknownNameError("scripted policy", name, _SCRIPTS)
    return _SCRIPTS[name]()


def list_scripted() -> list[PolicyListing]:
    """All scripted policies; they need no download."""
    digest = source_hash()
    return [PolicyListing(f"scripted:{name}", True, digest, PROVENANCE["source"]) for name in _SCRIPTS]
